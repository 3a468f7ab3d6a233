"""Inverse kinematics of the arm of dual-triangles: two links in closed form, given the angles before them."""

import math
from typing import NamedTuple

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.checks import check_count, check_finite, check_single
from tensegrity_envs.mechanics.dual_triangle.kinematics import DualTriangleKinematics


class InverseSolution(NamedTuple):
    """One solution of the inverse kinematics.

    Attributes:
        configuration: the angles [rad], those of the last two segments in (-pi, pi].
        elbow: sign of the last angle: 1, -1, or 0 where the last two links are in line.
        is_within_limits: whether every angle is within the joint limits.
        singularity: see `DualTriangle.jacobian_determinant` [m2].
        residual: distance of its forward kinematics from the target [m].
    """

    configuration: tuple[float, ...]
    elbow: int
    is_within_limits: bool
    singularity: float
    residual: float


def inverse_kinematics(arm: DualTriangleKinematics, x: float, y: float, *first: float) -> list[InverseSolution]:
    """The solutions and their order: see `DualTriangle.inverse_kinematics`.

    Raises:
        ValueError: a number is not finite, the arm has one segment, or it is a batch of designs.
    """
    check_single(arm._probe, "inverse_kinematics")
    check_finite("target", (x, y), 2)
    if arm.segments < 2:
        raise ValueError("inverse_kinematics: the tip of one segment has no two coordinates to choose")
    names = "all angles but the last two; redundancy(x, y, start) picks a configuration"
    check_count("first", first, arm.segments - 2, names=names)
    check_finite("first", first, arm.segments - 2)
    wrist = arm.wrist((x, y), first)
    slop = 1e-13 * float(arm.link_lengths[-2] + arm.link_lengths[-1]) ** 2
    if wrist.stretch < -slop or wrist.folding < -slop:
        return []
    solutions = []
    for elbow in (1, -1) if slop < wrist.stretch and slop < wrist.folding else (0,):
        last = -wrist.angle if elbow < 0 else wrist.angle
        q = (*(float(angle) for angle in first), wrap(arm.before_last(wrist, last)), last)
        end = arm.tip(q)
        residual = math.hypot(end[0] - x, end[1] - y)
        solutions.append(
            InverseSolution(q, elbow, bool(arm.is_within_limits(q)), arm.jacobian_determinant(q), residual)
        )
    return solutions


def wrap(angle: Component) -> Component:
    """The same direction in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)
