"""Many configurations with the tip at a target: all of an arm of two joints, a spread of those of longer arms."""

import numpy as np

from tensegrity_envs.mechanics.n_x.chain import CableArm
from tensegrity_envs.mechanics.n_x.inverse import all_solutions
from tensegrity_envs.mechanics.n_x.redundancy import starts

PROJECTED = 60


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
