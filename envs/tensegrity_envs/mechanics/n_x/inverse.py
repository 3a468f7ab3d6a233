"""Inverse kinematics of one and of two joints: every solution. Of more joints `redundancy` picks one."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.mechanics.n_x.chain import CableArm
from tensegrity_envs.mechanics.n_x.design import NXDesign
from tensegrity_envs.mechanics.n_x.pair import Lengths, solve_pair


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


def lengths(design: NXDesign) -> list[Lengths]:
    """The joints of a single design."""
    columns = (design.each(field) for field in ("b", "l", "a"))
    return [Lengths(*map(float, row)) for row in zip(*columns, strict=True)]


def last_joints(design: NXDesign, count: int) -> NXDesign:
    """The design of the last joints, for kinematics: cables per joint."""
    fields: dict[str, Any] = {name: design.each(name)[-count:] for name in ("b", "l", "a", "k_left", "k_right")}
    return replace(design, joints=count, routing="per_joint", **fields)


def all_solutions(arm: CableArm, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All solutions of an arm of one or two joints: index of the target, configurations (n, k), residuals [m].

    Raises:
        ValueError: the target is the base, which arms without offsets and with equal joints reach in a continuum.
    """
    design, limit = arm.design, float(arm.design.joint_limit)
    joints = lengths(design)
    if arm.degrees_of_freedom == 2:
        if joints[0] == joints[1] and joints[0].a == 0 and (np.hypot(x, y) < 1e-12 * joints[0].l).any():
            raise ValueError(
                "target (0, 0): the base, which every configuration with alpha_1 + alpha_2 = +-2 pi reaches"
            )
        return solve_pair(joints[0], joints[1], arm.tip, arm.jacobian, x, y, limit)
    (joint,) = joints
    found = np.concatenate(joint.angles_at(x, y, x * x + y * y))
    owner = np.tile(np.arange(len(x)), 3)
    fine = np.isfinite(found) & (np.abs(found) <= limit)
    owner, found = owner[fine], found[fine]
    px, py = joint.end(found)
    residual = np.hypot(px - x[owner], py - y[owner])
    on_curve = residual < 1e-9 * (joint.l + joint.a)
    owner, found, residual = owner[on_curve], found[on_curve], residual[on_curve]
    _, first = np.unique(np.round(np.stack([owner, found]), 9), axis=1, return_index=True)
    return owner[first], found[None, first], residual[first]
