"""Branches of equilibria under a growing load, followed past folds and onto the buckled shapes.

Pseudo-arclength continuation in (q, p): the load is p times a direction, p is one more unknown, and the additional
equation is a given distance along the tangent. So the curve may turn back in p. See Keller, "Numerical solution of
bifurcation and nonlinear eigenvalue problems", 1977.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tensegrity_envs.mechanics.dual_triangle.loads import stacked
from tensegrity_envs.mechanics.dual_triangle.statics import DualTriangleStatics

_STRAIGHT = 0.98  # cosine of the largest turn of the tangent in one step


class Branch(NamedTuple):
    """A branch of equilibria.

    Attributes:
        load: size of the load along its direction [N], shape (m,).
        configuration: angles [rad], shape (m, n).
        stability_margin: see `DualTriangle.stability_margin`, shape (m,).
        is_stable: shape (m,).
        reason: why it ends.
    """

    load: np.ndarray
    configuration: np.ndarray
    stability_margin: np.ndarray
    is_stable: np.ndarray
    reason: str


class _Curve:
    """Residual and derivative of the equilibria of an arm in z = (q, p / unit)."""

    def __init__(self, arm: DualTriangleStatics, free_lengths: Sequence[float], direction: tuple[float, float]) -> None:
        self.arm, self.free_lengths, self.direction = arm, free_lengths, direction
        self.unit = float(arm.stiffness_scale / arm.base_height)  # [N]: k b

    def evaluate(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient over the stiffness scale, (n,), and its derivative, (n, n + 1)."""
        arm, q = self.arm, tuple(float(value) for value in z[:-1])
        p = float(z[-1]) * self.unit
        gradient, hessian = arm.statics(q, self.free_lengths, (p * self.direction[0], p * self.direction[1]))
        by_load = -np.array(arm.load_torques(q, self.direction)) * self.unit
        table = np.column_stack([stacked(hessian), by_load])
        return np.array(gradient) / arm.stiffness_scale, table / arm.stiffness_scale

    def correct(self, z: np.ndarray, row: np.ndarray, value: float) -> tuple[np.ndarray, bool]:
        """Newton's method on the equilibrium and row . z = value."""
        last = math.inf
        for _ in range(12):
            residual, table = self.evaluate(z)
            try:
                step = np.linalg.solve(np.vstack([table, row]), np.append(residual, row @ z - value))
            except np.linalg.LinAlgError:
                return z, False
            z = z - step
            size = float(np.abs(step).max())
            if size < 1e-13 or (size < 1e-11 and size >= last):
                return z, True
            if size > 0.5 or not math.isfinite(size):
                return z, False
            last = size
        return z, last < 1e-10

    def tangent(self, z: np.ndarray, like: np.ndarray) -> np.ndarray:
        """Unit tangent, in the direction of `like`: the right singular vector of the smallest singular value."""
        tangent = np.linalg.svd(self.evaluate(z)[1])[2][-1]
        return np.asarray(tangent if tangent @ like >= 0 else -tangent)


def follow_load(
    arm: DualTriangleStatics,
    free_lengths: Sequence[float],
    direction: tuple[float, float],
    z0: np.ndarray,
    heading: np.ndarray,
    max_load: float,
    min_load: float,
    step: float,
    max_points: int,
) -> Branch:
    """The branch from the equilibrium z0 = (q, load [N]) in the direction `heading` (q, load / (k b))."""
    curve = _Curve(arm, free_lengths, direction)
    limit = float(arm.design.joint_limit)
    n = arm.segments
    z = np.append(z0[:-1], z0[-1] / curve.unit)
    top, bottom = max_load / curve.unit, min_load / curve.unit
    points = [z]
    tangent = heading / np.linalg.norm(heading)
    length, reason = step, "the largest number of points was computed"
    while len(points) < max_points:
        ahead, converged = curve.correct(z + length * tangent, tangent, float(tangent @ z) + length)
        next_tangent = curve.tangent(ahead, tangent) if converged else tangent
        if not converged or next_tangent @ tangent < _STRAIGHT:
            if length > step * 1e-4:
                length /= 2
                continue
            if not converged:
                reason = "the branch could not be continued"
                break
        beyond = np.abs(ahead[:-1]) > limit
        over = ahead[-1] > top or ahead[-1] < bottom
        if beyond.any() or over:
            # the end itself: the same equations with the quantity that is first beyond its bound held at it
            rows = [(np.eye(n + 1)[j], math.copysign(limit, ahead[j])) for j in np.flatnonzero(beyond)]
            rows += [(np.eye(n + 1)[n], top if ahead[-1] > top else bottom)] if over else []
            row, value = min(rows, key=lambda rv: (rv[1] - rv[0] @ z) / (rv[0] @ (ahead - z)))
            fraction = (value - row @ z) / (row @ (ahead - z))
            end, converged = curve.correct(z + fraction * (ahead - z), row, value)
            if converged:
                points.append(end)
            reason = "the largest load was reached" if row[n] and value == top else "the smallest load was reached"
            if not row[n]:
                reason = f"q{int(np.argmax(row)) + 1} reached its limit"
            break
        z, tangent = ahead, next_tangent
        points.append(z)
        length = min(step, 1.5 * length)
    table = np.array(points)
    forces = table[:, -1] * curve.unit
    angles = tuple(table[:, i] for i in range(n))
    margin = arm.stability_margin(angles, free_lengths, (forces * direction[0], forces * direction[1]))
    margin = np.broadcast_to(margin, forces.shape)
    return Branch(forces, table[:, :-1], margin, margin > 0, reason)


def heading_in_load(
    arm: DualTriangleStatics, free_lengths: Sequence[float], direction: tuple[float, float], z0: np.ndarray
) -> np.ndarray:
    """Tangent of the branch at z0 = (q, load [N]), towards a growing load."""
    curve = _Curve(arm, free_lengths, direction)
    up = np.zeros(arm.segments + 1)
    up[-1] = 1.0
    return curve.tangent(np.append(z0[:-1], z0[-1] / curve.unit), up)
