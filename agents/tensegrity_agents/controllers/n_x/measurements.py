"""What the nominal model makes of an observation of an n-X arm: its joint angles and its payload."""

import numpy as np

from tensegrity_agents.controllers.two_x.measurements import Estimate
from tensegrity_envs.mechanics import NX
from tensegrity_envs.mechanics.optima.projection import project
from tensegrity_envs.observation import DecodedObservation

_ROUNDS = 12  # of Gauss's and Newton's method


def at_rest(model: NX, observed: DecodedObservation) -> np.ndarray:
    """Where the model rests under the measured tensions, (n, joints) [rad]; upright where it finds no rest."""
    upright = np.zeros((model.degrees_of_freedom, len(observed)))
    rest = model.equilibrium(tuple(observed.tensions.T), tuple(upright))
    return np.where(np.asarray(rest.is_stable)[:, None], np.stack(rest.configuration, axis=1), 0.0)


def configuration_of(model: NX, observed: DecodedObservation, near: np.ndarray | None) -> np.ndarray:
    """Joint angles of shape (n, joints): observed, or else those with the tip where it is seen, close to `near`.

    Without `near`, close to where the model rests under the measured tensions.
    """
    if "joint_angles" in observed:
        return observed.joint_angles
    guess = at_rest(model, observed) if near is None else near
    limit = float(model.design.joint_limit)
    found, there = project(model, guess.T, observed.tip[:, 0], observed.tip[:, 1], limit)
    return np.where(there[:, None], found.T, guess)


def estimate_payload(model: NX, observed: DecodedObservation) -> Estimate:
    """Configuration and payload with which the arm rests under the measured tensions with its tip where it is seen.

    Equilibrium and tip are more equations than there are unknowns. From where the arm rests without the payload, steps
    of Gauss's and Newton's method change the payload p by the tip error along d tip / d p = -gravity C (0, 1), C the
    compliance of the tip at these tensions, and the arm comes to rest anew.
    """
    tensions, gravity = tuple(observed.tensions.T), float(model.design.gravity)
    q = at_rest(model, observed)
    extra = np.zeros(len(q))
    lowest = -float(np.max(model.design.payload))
    best, error, known = q, np.full(len(q), np.inf), extra
    for _ in range(_ROUNDS):
        load = (0.0 * extra, -gravity * extra)
        rest = model.equilibrium(tensions, tuple(q.T), load)
        q = np.where(np.asarray(rest.is_stable)[:, None], np.stack(rest.configuration, axis=1), q)
        off = observed.tip - np.stack(model.tip(tuple(q.T)), axis=1)
        here = np.hypot(*off.T)
        better = here < error
        best, error, known = (
            np.where(better[:, None], q, best),
            np.where(better, here, error),
            np.where(better, extra, known),
        )
        (_, xy), (_, yy) = model.tip_compliance(tuple(q.T), tensions, load)
        slope = -gravity * np.stack([xy, yy], axis=1)
        change = (slope * off).sum(axis=1) / np.maximum((slope * slope).sum(axis=1), 1e-12)
        extra = np.maximum(extra + np.clip(change, -0.1, 0.1), lowest)
    return Estimate(best, model.design.payload + known)
