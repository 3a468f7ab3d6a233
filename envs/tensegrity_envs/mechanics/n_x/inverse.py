"""Inverse kinematics of one and of two joints: every solution. Of more joints `redundancy` picks one."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.mechanics.n_x.chain import CableArm
from tensegrity_envs.mechanics.n_x.design import NXDesign
from tensegrity_envs.mechanics.x_joints.curve import angle_on_curve
from tensegrity_envs.mechanics.x_joints.pairs import crossings, solve


class InverseSolution(NamedTuple):
    """One solution of the inverse kinematics.

    Attributes:
        configuration: (alpha_1, ..., alpha_n) [rad].
        state: "U" (up, |alpha| < pi) or "D" (down) for each joint, such as "UD".
        singularity: see `NX.jacobian_determinant`.
        stability_margin: see `NX.stability_margin`.
        wrench_margin: see `NX.wrench_margin`.
        residual: distance of its forward kinematics from the target [m].
    """

    configuration: tuple[float, ...]
    state: str
    singularity: float
    stability_margin: float
    wrench_margin: float
    residual: float

    @property
    def is_stable_wrench_feasible(self) -> bool:
        """Whether feasible tensions hold this configuration in stable equilibrium."""
        return self.stability_margin > 0 and self.wrench_margin >= 0


def last_joints(design: NXDesign, count: int) -> NXDesign:
    """The design of the last joints, for kinematics: cables per joint."""
    fields: dict[str, Any] = {name: design.each(name)[-count:] for name in ("b", "l", "a", "k_left", "k_right")}
    return replace(design, joints=count, routing="per_joint", **fields)


def all_solutions(arm: CableArm, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All solutions of an arm of one or two joints: index of the target, configurations (n, k), residuals [m].

    Raises:
        ValueError: the target is the base, which arms without offsets and with equal joints reach in a continuum.
    """
    limit = float(arm.design.joint_limit)
    if arm.degrees_of_freedom == 2:
        owner, q, residual = solve(arm, x, y)
        return owner, np.stack(q), residual
    (bars,) = arm.bars
    alpha, u, rc, rr = angle_on_curve(bars, x, y, x * x + y * y)
    node, fold = crossings(bars, u, rc, rr)
    owner, found = np.concatenate([np.arange(len(x)), node, node]), np.concatenate([alpha, fold, -fold])
    fine = np.abs(found) <= limit
    owner, found = owner[fine], found[fine]
    px, py = arm.tip((found,))
    residual = np.hypot(px - x[owner], py - y[owner])
    on_curve = residual < 1e-9 * arm.reach
    owner, found, residual = owner[on_curve], found[on_curve], residual[on_curve]
    _, first = np.unique(np.round(np.stack([owner, found]), 9), axis=1, return_index=True)
    return owner[first], found[None, first], residual[first]
