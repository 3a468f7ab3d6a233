"""Many configurations with the tip at a target: all of an arm of two joints, a spread of those of longer arms."""

import numpy as np

from tensegrity_envs.mechanics.n_x.chain import CableArm
from tensegrity_envs.mechanics.n_x.inverse import all_solutions, last_joints
from tensegrity_envs.mechanics.optima.projection import project
from tensegrity_envs.mechanics.x_joints.curve import beyond
from tensegrity_envs.mechanics.x_joints.pairs import solve

PROJECTED = 60
_FIRST_ANGLES = 40  # of joint 1, for which all configurations of the other two are starts


def postures_at(arm: CableArm, x: np.ndarray, y: np.ndarray, count: int = PROJECTED) -> tuple[np.ndarray, np.ndarray]:
    """Configurations within the joint limits with the tip at the targets (m,).

    Of three joints, all at 40 values of alpha_1 and `count` projected ones; of more, the latter alone.

    Args:
        arm: of two joints or more; of a batch of designs, which must differ in no length, the kinematics.
        x: shape (m,) [m].
        y: shape (m,) [m].
        count: starts that are projected.

    Returns:
        The indices (k,) of their targets, and the configurations (n, k) [rad].
    """
    kinematics = arm.take(0)
    limit = min(float(arm.design.joint_limit), np.pi - 1e-9)
    if arm.degrees_of_freedom == 2:
        owner, q, _ = all_solutions(kinematics, x, y)
        return owner, q
    return starts(kinematics, x, y, limit, count)


def starts(arm: CableArm, x: np.ndarray, y: np.ndarray, limit: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (n, k) with the tip at the targets (m,), and the indices (k,) of their targets."""
    n, m = arm.degrees_of_freedom, len(x)
    rng = np.random.default_rng(0)
    owner = np.repeat(np.arange(m), count)
    spread = rng.uniform(-limit, limit, (n, count)) * rng.choice([0.1, 0.5, 1.0], count)
    q, there = project(arm, np.tile(spread, m), x[owner], y[owner], limit)
    owner, q = owner[there], q[:, there]
    if n > 3:
        return owner, q
    angles = np.linspace(-limit, limit, _FIRST_ANGLES)
    target, first = np.repeat(np.arange(m), len(angles)), np.tile(angles, m)
    dx, dy, _ = beyond(arm.bars[0], x[target], y[target], first)
    tail = type(arm)(last_joints(arm.design, 2))
    line, others, _ = solve(tail, dx, dy)
    return np.concatenate([owner, target[line]]), np.hstack([q, np.vstack([first[line], *others])])
