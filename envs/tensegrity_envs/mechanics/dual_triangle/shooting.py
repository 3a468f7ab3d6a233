"""All equilibria of a chain, by shooting from the tip to the base.

The direction phi_n of the last link fixes the load's moment about the last pivot, hence (on a stretch of angles where
the torque is monotone) that segment's angle, hence the direction of the link before, and so on: one unknown, phi_n, and
one equation, that the base has the direction 0. Every choice of one monotone stretch per segment is scanned; cells in
which zeros may hide (ends of a stretch, extrema of the residual) are divided further. What is found is polished by
Newton's method on the energy itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from tensegrity_envs.mechanics.dual_triangle.chain import DualTriangle
    from tensegrity_envs.mechanics.dual_triangle.segment import DualTriangleSegment

_SAMPLES = 2000
_PARTS = 12  # that an interesting cell is divided into, each of so many times:
_ROUNDS = 4
_NEAR = 0.1  # [rad] residual at which an end or an extremum is tried as a solution
_TABLE = 256  # points of a stretch: its inverse is interpolated, then improved by so many Newton steps:
_STEPS = 2


class _Stretch(NamedTuple):
    """A stretch of angles on which a segment's dU/dq is monotone, tabulated in ascending order of dU/dq."""

    angles: np.ndarray
    slopes: np.ndarray


class _State(NamedTuple):
    """Between two segments, on the way to the base, for many directions of the tip.

    The direction of the link [rad], the load's moment about its far pivot [N m], and the margin (negative outside) of
    every moment so far in its stretch.
    """

    direction: np.ndarray
    moment: np.ndarray
    margin: np.ndarray


def _stretches(segment: DualTriangleSegment, pair: tuple[float, float]) -> list[_Stretch]:
    limit = float(segment.design.joint_limit)
    angles = -limit * np.cos(np.linspace(0.0, np.pi, 2001))
    positive = np.asarray(segment.stiffness(angles, pair)) > 0
    change = np.flatnonzero(positive[1:] != positive[:-1])
    low, high, before = angles[change], angles[change + 1], positive[change]
    for _ in range(60):
        middle = (low + high) / 2
        same = (np.asarray(segment.stiffness(middle, pair)) > 0) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    ends = np.concatenate([[-limit], (low + high) / 2, [limit]])
    stretches = []
    for a, b in pairwise(ends):
        table = (a + b) / 2 - (b - a) / 2 * np.cos(np.linspace(0.0, np.pi, _TABLE))
        slopes = -np.asarray(segment.torque(table, pair))
        if slopes[0] > slopes[-1]:
            table, slopes = table[::-1], slopes[::-1]
        if slopes[-1] - slopes[0] > 1e-12 * segment.stiffness_scale:  # else both cables are slack
            stretches.append(_Stretch(table, np.maximum.accumulate(slopes)))
    return stretches


def _angle_on(
    segment: DualTriangleSegment, pair: tuple[float, float], stretch: _Stretch, moment: np.ndarray
) -> np.ndarray:
    """The angle at which the springs balance a moment from outside; the end of the stretch where none does."""
    angles, slopes = stretch
    cell = np.clip(np.searchsorted(slopes, moment) - 1, 0, len(slopes) - 2)
    a, b = angles[cell], angles[cell + 1]
    low, high = np.minimum(a, b), np.maximum(a, b)
    q = np.interp(moment, slopes, angles)
    rises = angles[-1] > angles[0]
    for _ in range(_STEPS):
        slope, stiffness = segment.slope_and_stiffness(np, segment.springs(np, q), pair)
        excess = slope - moment
        above = (excess > 0) == rises
        low, high = np.where(above, low, q), np.where(above, q, high)
        flat = np.abs(stiffness) < 1e-300
        step = q - excess / np.where(flat, 1.0, stiffness)
        q = np.where(flat | (step < low) | (step > high), (low + high) / 2, step)
    return np.asarray(q)


def candidates(arm: DualTriangle, free_lengths: Sequence[float], load: Sequence[float]) -> np.ndarray:
    """Configurations next to every equilibrium, shape (n, any number)."""
    segment, n = arm.segment, arm.segments
    pairs = [(float(free_lengths[2 * i]), float(free_lengths[2 * i + 1])) for i in range(n)]
    tables = [_stretches(segment, pair) for pair in pairs]
    fx, fy = (float(f) for f in load)
    scale = segment.stiffness_scale

    def step(i: int, stretch: _Stretch, state: _State) -> tuple[_State, np.ndarray]:
        """Across segment i, towards the base."""
        moment = state.moment + arm.link_lengths[i] * (fy * np.cos(state.direction) - fx * np.sin(state.direction))
        low, high = stretch.slopes[0], stretch.slopes[-1]
        margin = np.minimum(state.margin, np.minimum(moment - low, high - moment) / scale)
        q = _angle_on(segment, pairs[i], stretch, np.clip(moment, low, high))
        return _State(state.direction - q, moment, margin), q

    def shoot(choice: Sequence[_Stretch], phi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Direction left at the base, how far every moment is inside its stretch, and the configuration."""
        state = _State(phi, np.zeros_like(phi), np.full_like(phi, np.inf))
        q = np.empty((n, *phi.shape))
        for i in reversed(range(n)):
            state, q[i] = step(i, choice[i], state)
        return state.direction, state.margin, q

    widest = n * float(segment.design.joint_limit)
    phi = np.linspace(-widest, widest, _SAMPLES + 1)
    found = [np.empty((n, 0))]

    def scan(i: int, chosen: tuple[_Stretch, ...], state: _State) -> None:
        """Every choice for the segments i, i - 1, ... that some direction of the tip is compatible with."""
        if i < 0:
            found.append(_zeros(partial(shoot, chosen), phi))
            return
        for stretch in tables[i]:
            there, _ = step(i, stretch, state)
            if there.margin.max() > -2 * np.abs(np.diff(there.margin)).max():
                scan(i - 1, (stretch, *chosen), there)

    scan(n - 1, (), _State(phi, np.zeros_like(phi), np.full_like(phi, 1e3)))
    return np.concatenate(found, axis=1)


def _zeros(shoot: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]], phi: np.ndarray) -> np.ndarray:
    base, margin, q = shoot(phi)
    for _ in range(_ROUNDS):
        cells = _interesting(phi, base, margin)
        if not len(cells):
            break
        inner = np.arange(1, _PARTS) / _PARTS
        new = (phi[cells, None] + (phi[cells + 1] - phi[cells])[:, None] * inner).ravel()
        more = shoot(new)
        order = np.argsort(np.concatenate([phi, new]), kind="stable")
        phi = np.concatenate([phi, new])[order]
        base = np.concatenate([base, more[0]])[order]
        margin = np.concatenate([margin, more[1]])[order]
        q = np.concatenate([q, more[2]], axis=1)[:, order]
    valid = margin >= 0
    cell = np.flatnonzero(valid[1:] & valid[:-1] & (base[1:] * base[:-1] <= 0))
    low, high, sign = phi[cell], phi[cell + 1], np.sign(base[cell])
    for _ in range(16 if len(cell) else 0):
        middle = (low + high) / 2
        same = np.sign(shoot(middle)[0]) == sign
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    crossings = shoot((low + high) / 2)[2] if len(cell) else np.empty((len(q), 0))
    size = np.where(valid, np.abs(base), np.inf)
    padded = np.concatenate([[np.inf], size, [np.inf]])
    least = (size <= padded[:-2]) & (size <= padded[2:]) & (size < _NEAR)
    return np.concatenate([crossings, q[:, least]], axis=1)


def _interesting(phi: np.ndarray, base: np.ndarray, margin: np.ndarray) -> np.ndarray:
    """Cells at the ends of the valid range, and next to extrema of residual and margin that may hide zeros."""
    valid = margin >= 0
    marked = np.zeros(len(phi), bool)
    edge = np.flatnonzero(valid[1:] != valid[:-1])
    inner = np.arange(1, len(phi) - 1)
    size = np.where(valid, np.abs(base), np.inf)
    dip = valid[1:-1] & (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:])
    dip &= (base[:-2] * base[1:-1] > 0) & (base[2:] * base[1:-1] > 0)  # else it is a crossing
    around = np.abs(base[:-2] - base[1:-1]) + np.abs(base[2:] - base[1:-1])
    dip &= size[1:-1] < 4 * around + 1e-12
    turn = (margin[1:-1] - margin[:-2]) * (margin[2:] - margin[1:-1]) <= 0
    change = np.abs(margin[1:-1] - margin[:-2]) + np.abs(margin[2:] - margin[1:-1])
    turn &= np.abs(margin[1:-1]) < 4 * change
    marked[inner[dip | turn]] = True
    marked[inner[dip | turn] - 1] = True
    marked[edge] = True
    cells = np.flatnonzero(marked[:-1])
    return np.asarray(cells[phi[cells + 1] - phi[cells] > 1e-12])


def polish(arm: DualTriangle, free_lengths: Sequence[float], load: Sequence[float], points: np.ndarray) -> np.ndarray:
    """Damped Newton steps from every point; the distinct equilibria strictly inside the limits, sorted, (n, any)."""
    limit, scale, n = float(arm.design.joint_limit), arm.stiffness_scale, arm.segments

    def statics(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        gradient, hessian = arm.statics(tuple(q), free_lengths, load)
        shape = q.shape[1:]
        return (
            np.stack([np.broadcast_to(g, shape) for g in gradient], axis=-1),
            np.stack([np.stack([np.broadcast_to(h, shape) for h in row], axis=-1) for row in hessian], axis=-2),
        )

    for _ in range(40):
        if not points.shape[1]:
            return points
        gradient, hessian = statics(points)
        size = np.abs(gradient).max(axis=1) / scale
        # Levenberg's damping, quadratically small in the gradient: finite steps where the Hessian is singular
        damping = scale**2 * (1e-3 * size**2 + 1e-28)
        normal = np.einsum("kij,kil->kjl", hessian, hessian) + damping[:, None, None] * np.eye(n)
        step = np.linalg.solve(normal, np.einsum("kij,ki->kj", hessian, gradient)[..., None])[..., 0].T
        length = np.abs(step).max(axis=0)
        points = points - step * np.minimum(1.0, 0.2 / np.maximum(length, 1e-300))
        near = np.abs(points).max(axis=0) < limit + 0.3
        points, length = points[:, near], length[near]
        if len(length) and length.max() < 1e-15:
            break
    gradient, _ = statics(points)
    good = np.linalg.norm(gradient, axis=1) <= 1e-11 * (scale + np.hypot(load[0], load[1]) * arm.reach)
    good &= np.abs(points).max(axis=0) < limit - 1e-11
    distinct: list[np.ndarray] = []
    for point in points[:, good].T:
        if not any(np.abs(point - other).max() < 1e-6 for other in distinct):
            distinct.append(point)
    return np.array(sorted(distinct, key=tuple)).reshape(-1, n).T


def grid_of_starts(arm: DualTriangle) -> np.ndarray:
    """Starts all over the box of angles, for cables: where both are slack the chain of moments breaks."""
    limit, n = float(arm.design.joint_limit), arm.segments
    count = max(3, round(4000 ** (1 / n))) if n < 7 else 2
    axis = np.linspace(-0.97, 0.97, count) * limit
    return np.array(np.meshgrid(*[axis] * n, indexing="ij")).reshape(n, -1)
