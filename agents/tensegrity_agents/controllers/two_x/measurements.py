"""What the nominal model makes of an observation of the 2-X: its joint angles and its payload."""

from typing import NamedTuple

import numpy as np

from tensegrity_envs.mechanics import TwoX
from tensegrity_envs.observation import DecodedObservation


class Estimate(NamedTuple):
    """Configuration and payload that explain an observation.

    Attributes:
        configuration: shape (n, 2) [rad].
        payload: shape (n,) [kg].
    """

    configuration: np.ndarray
    payload: np.ndarray


def configuration_from_tip(model: TwoX, observed: DecodedObservation, near: np.ndarray | None) -> np.ndarray:
    """Joint angles of shape (n, 2): observed, or else from the tip by inverse kinematics.

    Of several inverse solutions, the one closest to `near` (the last known configuration), or without it the one that
    is closest to equilibrium under the measured tensions according to the model.
    """
    if "joint_angles" in observed:
        return observed.joint_angles
    table, missing = solutions(model, observed.tip)
    if near is not None:
        score = np.abs(table - near.T[:, :, None]).max(axis=0)
    else:
        gradient = model_columns(model, table, observed.tensions)
        score = np.hypot(*gradient)
    score = np.where(missing, np.inf, score)
    best = np.argmin(score, axis=1)
    rows = np.arange(len(best))
    found = table[:, rows, best].T
    if near is not None:  # close to a singularity rounding may leave the tip without an inverse solution
        found = np.where(np.isfinite(score[rows, best])[:, None], found, near)
    return np.asarray(np.nan_to_num(found))


def estimate_payload(nominal: TwoX, observed: DecodedObservation) -> Estimate:
    """Configuration and payload from tip and tensions: the payload is hidden, but in a static task it can be
    identified.

    For each inverse solution of the tip the two equilibrium equations are linear in the payload; least squares gives
    it, and the solution whose residual is smallest is the configuration.
    """
    table, missing = solutions(nominal, observed.tip)
    if "joint_angles" in observed:
        table, missing = observed.joint_angles.T[:, :, None], np.zeros((len(observed.tip), 1), bool)
    balance = np.stack(model_columns(nominal, table, observed.tensions))  # gradient with the nominal payload [N m]
    lever = np.stack(nominal.jacobian(tuple(table))[1]) * nominal.design.gravity  # gradient of 1 kg at the tip
    extra = -(balance * lever).sum(axis=0) / np.maximum((lever * lever).sum(axis=0), 1e-12)
    extra = np.maximum(extra, -np.reshape(nominal.design.payload, (-1, 1)))  # of one design, or of n
    residual = np.hypot(*(balance + extra * lever))
    residual = np.where(missing, np.inf, residual)
    best = np.argmin(residual, axis=1)
    rows = np.arange(len(best))
    return Estimate(np.nan_to_num(table[:, rows, best].T), nominal.design.payload + np.nan_to_num(extra[rows, best]))


def solutions(model: TwoX, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse solutions of positions of shape (n, 2): a table (2, n, m) [rad], and where it has none (n, m)."""
    table = np.stack(model.inverse_kinematics_batch(position[:, 0], position[:, 1]))
    missing = np.isnan(table[0])
    return np.where(missing, 0.0, table), missing


def model_columns(model: TwoX, table: np.ndarray, tensions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Energy gradient [N m] at a table (2, n, m) of configurations under tensions (n, 4), of one design or of n."""
    gradient = model.energy_gradient(tuple(table.transpose(0, 2, 1)), tuple(tensions.T))
    first, second = (np.broadcast_to(part, table.shape[:0:-1]).T for part in gradient)
    return first, second
