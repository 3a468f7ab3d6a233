"""Actions that move the arm along a joint path within the rates of the environment."""

from collections.abc import Callable

import numpy as np

from tensegrity_envs.compiler.namespace import Components
from tensegrity_envs.mechanics import TwoX
from tensegrity_envs.simulation import JointControl, TensionControl

_SHARES = np.array([1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1, 0.05, 0.0])


def joint_action(here: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Straight towards `goal` (n, 2) [rad] as fast as the slower joint allows, exactly onto it in the last step."""
    change = goal - here
    return np.asarray(change / np.maximum(np.abs(change).max(axis=1, keepdims=True), JointControl.rate))


def resolved_rate(model: TwoX, q: np.ndarray, wanted: np.ndarray, damping: float) -> np.ndarray:
    """Joint steps (n, 2) [rad] for wanted tip steps (n, 2) [m]: J^T (J J^T + d^2 I)^-1 at q (n, 2), with d [m/rad]."""
    (xa, xb), (ya, yb) = model.jacobian(tuple(q.T))
    d = damping**2
    m11, m12, m22 = xa * xa + xb * xb + d, xa * ya + xb * yb, ya * ya + yb * yb + d
    det = m11 * m22 - m12 * m12
    u, v = (m22 * wanted[:, 0] - m12 * wanted[:, 1]) / det, (m11 * wanted[:, 1] - m12 * wanted[:, 0]) / det
    return np.stack([xa * u + ya * v, xb * u + yb * v], axis=1)


def tension_action(
    model: TwoX,
    commanded: np.ndarray,
    goal: np.ndarray,
    tensions: np.ndarray,
    tensions_of: Callable[[Components], Components] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Tension increments towards the stiffest tensions of the next configuration on the straight path to `goal`.

    Args:
        model: as the controller knows it, one design or n.
        commanded: configurations (n, 2) that the present command aims at [rad].
        goal: (n, 2) [rad].
        tensions: measured (n, 4) [N].
        tensions_of: of a command; the stiffest ones by default. Commands may then have further components.

    Returns:
        Actions (n, 4), and the configurations (n, 2) that they aim at: as far along the path as the rates allow. Where
        they allow nothing (the cables are not yet at their stiffest), the tensions go straight there, along the line of
        equal moments, which does not move the arm.
    """
    change = goal - commanded
    change = change / np.maximum(np.abs(change).max(axis=1, keepdims=True) / JointControl.rate, 1.0)
    low, high = model.design.min_tension, model.design.max_tension
    # (shares, n): all candidates at once
    ahead = commanded.T[:, None] + _SHARES[:, None] * change.T[:, None]
    wanted = np.clip(np.stack((tensions_of or model.stiffest_tensions)(tuple(ahead))), low, high)
    increments = (wanted - tensions.T[:, None]) / TensionControl.rate
    fits = np.abs(increments).max(axis=0) <= 1.0
    first = np.where(fits.any(axis=0), fits.argmax(axis=0), len(_SHARES) - 1)
    rows = np.arange(len(commanded))
    action = increments[:, first, rows].T
    action = action / np.maximum(np.abs(action).max(axis=1, keepdims=True), 1.0)
    return action, ahead[:, first, rows].T
