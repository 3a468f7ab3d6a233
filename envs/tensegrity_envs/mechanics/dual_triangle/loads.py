"""What a tip load does to an arm: critical loads, compliance, and which load a measured state reveals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, is_batch
from tensegrity_envs.mechanics.dual_triangle.local_optima import starts
from tensegrity_envs.mechanics.dual_triangle.self_motion import SINGLE, SelfMotion, self_motions
from tensegrity_envs.mechanics.dual_triangle.statics import DualTriangleStatics

_STARTS = 100  # of each kind, of Newton's method for more than three segments


class LoadedState(NamedTuple):
    """A configuration and a tip load that explain a measured tip position under known inputs.

    Attributes:
        configuration: the angles [rad].
        load: (fx, fy) [N].
        is_stable: whether the stiffness matrix is positive definite there.
        residual: norm of the energy gradient [N m].
    """

    configuration: Components
    load: tuple[Component, Component]
    is_stable: Component
    residual: Component


def stacked(rows: Sequence[Sequence[Component]]) -> np.ndarray:
    """A matrix of components as an array of shape (..., rows, columns)."""
    entries = np.broadcast_arrays(*(np.asarray(entry, float) for row in rows for entry in row))
    table = np.stack(entries, axis=-1)
    return table.reshape(*table.shape[:-1], len(rows), len(rows[0]))


def first_loss(at_zero: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """The smallest s >= 0 at which at_zero + s slope, symmetric (..., n, n), is not positive definite; else infinity.

    Where at_zero = V W V^T is positive definite, s = -1 / (smallest eigenvalue of W^(-1/2) V^T slope V W^(-1/2)), the
    generalized eigenvalue problem slope x = -(1/s) at_zero x.
    """
    values, vectors = np.linalg.eigh(at_zero)
    definite = values[..., 0] > 0
    root = 1 / np.sqrt(np.where(definite[..., None], values, 1.0))
    inner = np.einsum("...ji,...jk,...kl->...il", vectors, slope, vectors) * root[..., :, None] * root[..., None, :]
    least = np.linalg.eigvalsh(inner)[..., 0]
    falling = least < -1e-300
    return np.where(definite, np.where(falling, -1 / np.where(falling, least, -1.0), np.inf), 0.0)


def critical_load(
    arm: DualTriangleStatics, q: Sequence[Component], unit: tuple[Component, Component], common: Component
) -> np.ndarray:
    """`DualTriangle.critical_load` on arrays or floats, `unit` a direction of length 1."""
    scale = arm.stiffness_scale / arm.reach  # a force of the order of the critical ones

    def hessian(force: Component) -> np.ndarray:
        load = (force * unit[0], force * unit[1])
        lengths = arm.free_lengths(arm.control(q, load, common), common)
        return stacked(arm.stiffness_matrix(q, lengths, load))

    if arm.design.springs == "bilateral":
        start = hessian(0.0 * scale)
        return first_loss(start, (hessian(scale) - start) / np.asarray(scale)[..., None, None])
    return _critical_load_of_cables(arm, q, unit, common, scale, hessian)


def _critical_load_of_cables(
    arm: DualTriangleStatics,
    q: Sequence[Component],
    unit: tuple[Component, Component],
    common: Component,
    scale: float,
    hessian: Callable[[Component], np.ndarray],
) -> np.ndarray:
    """As above, from one force at which a cable becomes slack or taut to the next: between them H is affine."""
    bilateral = arm.as_bilateral()

    def tensions(force: float) -> np.ndarray:
        load = (force * unit[0], force * unit[1])
        return np.array(bilateral.spring_forces(q, arm.free_lengths(bilateral.control(q, load, common), common)))

    if not first_loss(hessian(0.0), hessian(0.0)):  # as where both cables of a segment are slack without a load
        return np.asarray(0.0)
    at_zero = tensions(0.0)
    slope = (tensions(scale) - at_zero) / scale
    with np.errstate(divide="ignore", invalid="ignore"):
        changes = -at_zero / slope
    moments = np.array(arm.load_torques(q, unit))
    ends = sorted({0.0, *(float(f) for f in changes if np.isfinite(f) and f > 0), math.inf})
    if not np.any(moments):
        ends = [0.0, math.inf]
    for low, high in pairwise(ends):
        width = high - low if math.isfinite(high) else scale
        first, second = low + 0.25 * width, low + 0.75 * width
        start = hessian(first)
        rise = (hessian(second) - start) / (second - first)
        at_low = start - rise * (first - low)
        loss = float(first_loss(at_low, rise))
        if low + loss <= high:
            return np.asarray(low + loss)
    return np.asarray(math.inf)


def straight_critical_loads(arm: DualTriangleStatics, common: Component) -> tuple[Component, ...]:
    """`DualTriangle.straight_critical_loads`."""
    n = arm.segments
    stiffness = [one.stiffness(0.0, one.free_lengths(one.control(0.0, 0.0, common), common)) for one in arm.chain]
    equal = arm.design.segments is None
    if equal and np.all(np.equal(arm.design.b1, arm.design.b2)):
        return tuple(
            2 * stiffness[0] / arm.design.b1 * math.sin((2 * m - 1) * math.pi / (4 * n)) ** 2 for m in range(1, n + 1)
        )
    # H = K - P R: R_ij is the distance of pivot max(i, j) from the tip, K the diagonal of the segments' stiffnesses
    arms = arm.jacobian((0.0,) * n)[1]
    table = stacked([[arms[max(i, j)] for j in range(n)] for i in range(n)])
    if equal:
        loads = np.asarray(stiffness[0])[..., None] / np.linalg.eigvalsh(table)[..., ::-1]
    else:  # R = C C^T is positive definite, K may be anything
        inverse = np.linalg.inv(np.linalg.cholesky(table))
        loads = np.linalg.eigvalsh(inverse * stacked([stiffness]) @ np.swapaxes(inverse, -1, -2))
    return tuple(float(p) if np.ndim(p) == 0 else p for p in np.moveaxis(loads, -1, 0))


def estimate_load(
    arm: DualTriangleStatics, q: Sequence[Component], free_lengths: Sequence[Component], torque: bool = False
) -> np.ndarray:
    """Least squares of J^T F + tau = -M(q), of minimal norm, on arrays (..., 2), or (..., 3) with the torque tau."""
    size = arm.reach  # a torque is measured as a force at this distance, so that the norm has one unit
    turns = [(size + 0.0 * q[0],) * arm.segments] if torque else []
    transposed = np.swapaxes(stacked([*arm.jacobian(q), *turns]), -1, -2)
    slopes = stacked([arm.energy_gradient(q, free_lengths)])[..., 0, :]
    found = np.asarray(np.einsum("...ij,...j->...i", np.linalg.pinv(transposed, rcond=1e-12), slopes))
    if torque:
        found[..., 2] *= size
    return found


def correct(
    arm: DualTriangleStatics,
    x: Component,
    y: Component,
    free_lengths: Sequence[Component],
    q: np.ndarray,
    load: np.ndarray,
    iterations: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Newton's method on (energy gradient, tip - target) = 0 in (q, load), shapes (n, m) and (2, m).

    Returns configuration, load, and the last step's length [rad].
    """
    n, m = q.shape
    scale, reach = np.asarray(arm.stiffness_scale), np.asarray(arm.reach)
    last = np.full(m, np.inf)
    for _ in range(iterations):
        gradient, hessian = arm.statics(tuple(q), free_lengths, tuple(load))
        jacobian, tip = arm.jacobian(tuple(q)), arm.tip(tuple(q))
        table = np.zeros((m, n + 2, n + 2))
        right = np.empty((m, n + 2))
        for i in range(n):  # torques over k b^2, lengths over the reach, forces in k b^2 / reach: all of order one
            right[:, i] = gradient[i] / scale
            for j in range(n):
                table[:, i, j] = hessian[i][j] / scale
            for j in range(2):
                table[:, i, n + j], table[:, n + j, i] = -jacobian[j][i] / reach, jacobian[j][i] / reach
        right[:, n], right[:, n + 1] = (tip[0] - x) / reach, (tip[1] - y) / reach
        table += 1e-15 * np.eye(n + 2)
        step = np.linalg.solve(table, right[..., None])[..., 0].T
        last = np.abs(step[:n]).max(axis=0)
        shrink = np.minimum(1.0, 0.3 / np.maximum(last, 1e-300))
        q, load = q - shrink * step[:n], load - shrink * step[n:] * scale / reach
        if last.max() < 1e-10:  # of a quadratic convergence
            break
    return q, load, last


def identify(arm: DualTriangleStatics, x: float, y: float, free_lengths: Sequence[float]) -> list[LoadedState]:
    """`DualTriangle.identify`: stationary points of the springs' energy along the self-motion curve of the tip."""
    limit = float(arm.design.joint_limit)
    if not arm.has_plain_links:
        _, begin = starts(arm, np.array([x]), np.array([y]), limit, _STARTS)
        return _explained(arm, x, y, free_lengths, begin, 40, np.inf)
    found: list[tuple[float, ...]] = []
    for _, curve in self_motions(np.array([x]), np.array([y]), *arm._plain_links()):
        points = 4000
        loop, s, _, after = curve.grid(points)
        width = 2 * math.pi / (points if curve.kind == SINGLE else points // 2)

        def slope(loop: np.ndarray, s: np.ndarray, curve: SelfMotion = curve) -> np.ndarray:
            """Derivative of the energy along the null vector of J, which turns continuously along the curve."""
            q = curve.at(np.zeros(len(s), int), loop, s)
            r, t = arm.jacobian(q)
            null = (r[1] * t[2] - r[2] * t[1], r[2] * t[0] - r[0] * t[2], r[0] * t[1] - r[1] * t[0])
            g = arm.energy_gradient(q, free_lengths)
            return np.asarray(g[0] * null[0] + g[1] * null[1] + g[2] * null[2])

        q = curve.at(np.zeros(points, int), loop, s)
        inside = np.abs(np.stack(q)).max(axis=0) < limit + 0.05
        values = slope(loop, s)
        cell = np.flatnonzero(inside & inside[after] & (values * values[after] <= 0))
        low, loops = s[cell], loop[cell]
        high, sign = low + width, np.sign(values[cell])
        dips = _dips(values, after)
        for place in np.flatnonzero(dips & inside):
            fine = s[place] + width * np.linspace(-1.0, 1.0, 65)
            there = slope(np.full(65, loop[place]), fine)
            for i in np.flatnonzero(there[1:] * there[:-1] <= 0):
                low, high = np.append(low, fine[i]), np.append(high, fine[i + 1])
                loops, sign = np.append(loops, loop[place]), np.append(sign, np.sign(there[i]))
        for _ in range(50):
            middle = (low + high) / 2
            same = np.sign(slope(loops, middle)) == sign
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        if len(low):
            found += list(zip(*(c.tolist() for c in curve.at(np.zeros(len(low), int), loops, low)), strict=True))
    if not found:
        return []
    return _explained(arm, x, y, free_lengths, np.array(found).T, 8, 1e-4)


def _explained(
    arm: DualTriangleStatics,
    x: float,
    y: float,
    free_lengths: Sequence[float],
    angles_found: np.ndarray,
    iterations: int,
    most: float,
) -> list[LoadedState]:
    """Distinct states that Newton's method leads to; where it moves by `most` [rad] or more, it is not followed."""
    limit = float(arm.design.joint_limit)
    if not angles_found.shape[1]:
        return []
    load = np.moveaxis(estimate_load(arm, tuple(angles_found), free_lengths), -1, 0)
    better, force, last = correct(arm, x, y, free_lengths, angles_found, load, iterations)
    moved = np.abs(better - angles_found).max(axis=0) < most  # else a singular system led elsewhere
    angles_found, load = np.where(moved, better, angles_found), np.where(moved, force, load)
    if math.isinf(most):
        angles_found, load = angles_found[:, last < 1e-9], load[:, last < 1e-9]
    states: list[LoadedState] = []
    for index in np.lexsort(angles_found[::-1]):
        angles = tuple(float(value) for value in angles_found[:, index])
        fx, fy = (float(value) for value in load[:, index])
        if max(map(abs, angles)) > limit + 1e-9:
            continue
        if any(max(abs(a - b) for a, b in zip(angles, s.configuration, strict=True)) < 1e-7 for s in states):
            continue
        residual = float(np.linalg.norm(arm.energy_gradient(angles, free_lengths, (fx, fy))))
        stable = bool(arm.stability_margin(angles, free_lengths, (fx, fy)) > 0)
        states.append(LoadedState(angles, (fx, fy), stable, residual))
    return states


def _dips(values: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Samples at which |values| has a local minimum without a change of sign that may hide two zeros."""
    before = np.empty_like(after)
    before[after] = np.arange(len(after))
    size = np.abs(values)
    dip = (size <= size[before]) & (size <= size[after])
    dip &= (values * values[before] > 0) & (values * values[after] > 0)
    around = np.abs(values[before] - values) + np.abs(values[after] - values)
    return np.asarray(dip & (size < 2 * around + 1e-300))


def identify_from(
    arm: DualTriangleStatics,
    x: Component,
    y: Component,
    free_lengths: Sequence[Component],
    start: Sequence[Component],
    load: Sequence[Component],
    iterations: int,
) -> LoadedState:
    """`DualTriangle.identify_from`."""
    single = not is_batch(arm._probe, x, y, *free_lengths, *start, *load)
    values = [np.atleast_1d(np.asarray(v, float)) for v in (x, y, *start, *load)]
    shape = np.broadcast_shapes(*(v.shape for v in values), *(np.shape(u) for u in free_lengths), np.shape(arm._probe))
    wide = [np.broadcast_to(v, shape) for v in values]
    n = arm.segments
    q, force, last = correct(
        arm, wide[0], wide[1], free_lengths, np.stack(wide[2 : n + 2]), np.stack(wide[n + 2 :]), iterations
    )
    good = last < 1e-8
    q, force = np.where(good, q, np.nan), np.where(good, force, np.nan)
    gradient = arm.energy_gradient(tuple(q), free_lengths, tuple(force))
    residual = np.sqrt(sum(np.asarray(g) ** 2 for g in gradient))
    stable = arm.stability_margin(tuple(q), free_lengths, tuple(force)) > 0
    if not single:
        return LoadedState(tuple(q), (force[0], force[1]), stable, residual)
    angles = tuple(float(value) for value in q[:, 0])
    return LoadedState(angles, (float(force[0, 0]), float(force[1, 0])), bool(stable[0]), float(residual[0]))
