"""What the nominal model makes of an observation of a planar 4-bar mechanism: its state, its force, its next step."""

import numpy as np

from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar
from tensegrity_envs.mechanics.planar_four_bar.equilibria import pointing
from tensegrity_envs.observation import DecodedObservation

NOTICEABLE = 5e-4  # smaller forces, and changes of it, count as none [K L]
_PRIOR = 1e-8  # of the information: the force is the smallest that explains everything


def configuration(mechanism: PlanarFourBar, observed: DecodedObservation) -> np.ndarray:
    """(theta, gamma) [rad], shape (n, 2), in stable equilibria: bar CF ends at the tip, bar DE points at its middle."""
    lengths = tuple(observed.actuator_lengths.T)
    (cx, cy), _ = mechanism.supports(lengths)
    gamma = np.arctan2(observed.tip[:, 1] - cy, observed.tip[:, 0] - cx)
    return np.stack([pointing(mechanism, lengths, gamma), gamma], axis=1)


def side(mechanism: PlanarFourBar, observed: DecodedObservation) -> np.ndarray:
    """On which side of the line CD the tip is, 1 or -1, shape (n,)."""
    (cx, cy), (dx, dy) = mechanism.supports(tuple(observed.actuator_lengths.T))
    x, y = observed.tip.T
    return np.where((cx - dx) * (y - dy) - (cy - dy) * (x - dx) > 0, 1.0, -1.0)


def force_across(mechanism: PlanarFourBar, observed: DecodedObservation) -> tuple[np.ndarray, np.ndarray]:
    """The direction across bar CF (n, 2), and the component of the force on F along it (n,) [N].

    That is all that a stable equilibrium reveals: along the bar F is held rigidly. In another posture the direction is
    another one.
    """
    q = configuration(mechanism, observed)
    lengths = tuple(observed.actuator_lengths.T)
    across = np.stack([-np.sin(q[:, 1]), np.cos(q[:, 1])], axis=1)
    gradient = mechanism.energy_gradient(tuple(q.T), lengths)[1]  # balanced by L t . f
    return across, np.asarray(gradient) / float(mechanism.length)


def with_posture(
    information: np.ndarray, evidence: np.ndarray, across: np.ndarray, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What is known of the force on F with one more posture.

    Args:
        information: sum of t t^T over the directions t across bar CF in which the force has been measured, (n, 2, 2).
        evidence: sum of t times what was measured, (n, 2) [N].
        across: see `force_across`.
        force: see `force_across`.

    Returns:
        The new information and evidence.
    """
    return information + across[:, :, None] * across[:, None, :], evidence + across * force[:, None]


def identified(mechanism: PlanarFourBar, information: np.ndarray, evidence: np.ndarray) -> np.ndarray:
    """The smallest force on F that explains all measurements, by least squares, (n, 2) [N]; tiny ones count as none."""
    inner = information + _PRIOR * np.eye(2)
    load = np.linalg.solve(inner, evidence[..., None])[..., 0]
    return np.where(np.hypot(*load.T)[:, None] < NOTICEABLE * float(mechanism.largest_force), 0.0, load)


def resolved_rate(
    mechanism: PlanarFourBar, lengths: np.ndarray, here: np.ndarray, error: np.ndarray, damping: float
) -> np.ndarray:
    """Changes of the lengths that move the tip by `error`, by the damped pseudo-inverse of the unloaded Jacobian.

    Args:
        mechanism: nominal.
        lengths: shape (n, 2) [m].
        here: see `side`.
        error: shape (n, 2) [m].
        damping: added to the singular values, squared [-].
    """
    square, rest = mechanism.flatness(tuple(lengths.T))
    regular = np.minimum(square, rest) > 1e-3
    safe = np.where(regular[:, None], lengths, float(mechanism.length) * np.array([1.2, 0.8]))
    jacobian: np.ndarray = np.moveaxis(np.array(mechanism.rectangle_jacobian(tuple(safe.T), here)), -1, 0)
    inner = np.einsum("nij,nkj->nik", jacobian, jacobian) + damping**2 * np.eye(2)
    return np.asarray(np.einsum("nji,njk,nk->ni", jacobian, np.linalg.inv(inner), error))
