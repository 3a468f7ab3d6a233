"""All equilibria of a chain, by boxes from the tip to the base.

The direction phi_n of the last link fixes the load's moment about the last pivot, hence (on a stretch of angles where
the torque is monotone) that segment's angle, hence the direction of the link before, and so on: one unknown, phi_n, and
one equation, that the base has the direction 0. An interval of phi_n gives intervals of all these. One whose last
interval leaves 0 out holds no equilibrium; all others are divided, until Newton's method on the energy itself takes
over. On stretches where both cables of a segment are slack, the moment has to be 0 and the angle is an unknown of its
own, with an interval of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from tensegrity_envs.mechanics.dual_triangle.one_segment import Stretch, stretches
from tensegrity_envs.mechanics.dual_triangle.segment_statics import SegmentStatics
from tensegrity_envs.mechanics.dual_triangle.statics import DualTriangleStatics

_CELLS = 64  # that the range of phi_n is divided into at first
_PARTS = 4  # that a box is divided into in every round
_SMALL = 2e-5  # [rad]: boxes of this width are handed to Newton's method
_MOST_BOXES = 150_000
_MOST_POINTS = 3000  # of boxes that are divided no further
_TABLE = 256  # points of a stretch, between which its inverse is bracketed
_TIGHT = 4e-16  # relative: outward rounding


class _Curve(NamedTuple):
    """A stretch of angles on which a segment's dU/dq is monotone, tabulated in ascending order of dU/dq.

    `slack` is the interval of angles in which both cables are, else None.
    """

    angles: np.ndarray
    slopes: np.ndarray
    slack: tuple[float, float] | None


class _Boxes(NamedTuple):
    """Intervals of phi_n, shape (2, m), the curve chosen for every segment and its free angles, (n, m), (2, n, m).

    A free angle is that of a segment with slack cables; all other entries of `angles` are without meaning.
    """

    phi: np.ndarray
    choice: np.ndarray
    angles: np.ndarray

    def take(self, index: np.ndarray) -> _Boxes:
        """The boxes at `index`."""
        return _Boxes(self.phi[:, index], self.choice[:, index], self.angles[:, :, index])


def _curve(segment: SegmentStatics, pair: tuple[float, float], stretch: Stretch) -> _Curve:
    if stretch.sign == 0:
        return _Curve(np.zeros(0), np.zeros(0), (stretch.low, stretch.high))
    a, b = stretch.low, stretch.high
    table = (a + b) / 2 - (b - a) / 2 * np.cos(np.linspace(0.0, np.pi, _TABLE))
    slopes = -np.asarray(segment.torque(table, pair))
    if stretch.sign < 0:
        table, slopes = table[::-1], slopes[::-1]
    return _Curve(table, np.maximum.accumulate(slopes), None)


def _bracket(
    segment: SegmentStatics, pair: tuple[float, float], curve: _Curve, moment: np.ndarray, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Angles between which the springs balance a moment within the curve's range, tighter after more steps."""
    cell = np.clip(np.searchsorted(curve.slopes, moment) - 1, 0, _TABLE - 2)
    a, b = curve.angles[cell], curve.angles[cell + 1]
    low, high = np.minimum(a, b), np.maximum(a, b)
    rises = curve.angles[-1] > curve.angles[0]
    q = (low + high) / 2
    for _ in range(steps):
        slope, stiffness = segment.slope_and_stiffness(np, segment.springs(np, q), pair)
        excess = slope - moment
        above = (excess > 0) == rises
        low, high = np.where(above, low, q), np.where(above, q, high)
        flat = np.abs(stiffness) < 1e-300
        # A little beyond Newton's point, so that the next one closes the bracket from the other side
        step = q - 1.01 * excess / np.where(flat, 1.0, stiffness)
        q = np.where(flat | ~(step > low) | ~(step < high), (low + high) / 2, step)
    return low, high


def _sinusoid(fx: float, fy: float, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The range of fy cos(phi) - fx sin(phi) on intervals of phi."""
    size, top = np.hypot(fx, fy), np.arctan2(-fx, fy)
    ends = size * np.cos(low - top), size * np.cos(high - top)
    turn = 2 * np.pi
    has_top = np.floor((high - top) / turn) >= np.ceil((low - top) / turn)
    has_bottom = np.floor((high - top - np.pi) / turn) >= np.ceil((low - top - np.pi) / turn)
    return np.where(has_bottom, -size, np.minimum(*ends)), np.where(has_top, size, np.maximum(*ends))


class _Shooter:
    """Intervals along the chain, from the tip to the base."""

    def __init__(self, arm: DualTriangleStatics, free_lengths: Sequence[float], load: Sequence[float]) -> None:
        self.arm, self.n, self.chain = arm, arm.segments, arm.chain
        self.pairs = [(float(free_lengths[2 * i]), float(free_lengths[2 * i + 1])) for i in range(self.n)]
        self.curves = [
            [_curve(segment, pair, stretch) for stretch in stretches(segment, pair)]
            for segment, pair in zip(self.chain, self.pairs, strict=True)
        ]
        self.fx, self.fy, self.torque = (*(float(f) for f in load), 0.0)[:3]
        self.limit = float(arm.design.joint_limit)
        size = np.hypot(self.fx, self.fy) * float(arm.reach) + abs(self.torque) + float(arm.stiffness_scale)
        self.slop = 64 * _TIGHT * size

    def moment(self, i: int, direction: np.ndarray, moment: np.ndarray) -> np.ndarray:
        """Intervals of the load's moment about pivot i, from link i's direction and the moment about the next pivot."""
        length = float(self.arm.link_lengths[i])
        low, high = _sinusoid(length * self.fx, length * self.fy, direction[0], direction[1])
        return np.stack([moment[0] + low - self.slop, moment[1] + high + self.slop])

    def angle(self, i: int, k: int, moment: np.ndarray, free: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Intervals of angle i on its curve k, and which of them there are."""
        curve = self.curves[i][k]
        if curve.slack is not None:
            return free, (moment[0] <= 0) & (moment[1] >= 0)
        least, most = curve.slopes[0] - self.slop, curve.slopes[-1] + self.slop
        there = (moment[1] >= least) & (moment[0] <= most)
        ends = [
            _bracket(self.chain[i], self.pairs[i], curve, np.clip(end, curve.slopes[0], curve.slopes[-1]), steps)
            for end in moment
        ]
        rises = curve.angles[-1] > curve.angles[0]
        first, last = (ends[0], ends[1]) if rises else (ends[1], ends[0])
        return np.stack([first[0], last[1]]), there

    def seed(self) -> _Boxes:
        """All boxes that may hold an equilibrium: every cell of phi_n with every choice of curves."""
        n, widest = self.n, self.n * self.limit
        edges = np.linspace(-widest, widest, _CELLS + 1)
        boxes = _Boxes(np.stack([edges[:-1], edges[1:]]), np.zeros((n, _CELLS), int), np.zeros((2, n, _CELLS)))
        direction, moment = boxes.phi, np.full((2, _CELLS), self.torque)
        for i in reversed(range(n)):
            moment = self.moment(i, direction, moment)
            kept = []
            for k, curve in enumerate(self.curves[i]):
                free = np.zeros_like(moment)
                if curve.slack is not None:
                    free[0], free[1] = curve.slack
                q, there = self.angle(i, k, moment, free, 0)
                after = np.stack([direction[0] - q[1], direction[1] - q[0]])
                there &= (after[0] <= i * self.limit) & (after[1] >= -i * self.limit)
                index = np.flatnonzero(there)
                part = boxes.take(index)
                part.choice[i], part.angles[:, i] = k, free[:, index]
                kept.append((part, after[:, index], moment[:, index]))
            boxes = _joined([part for part, _, _ in kept])
            direction = np.concatenate([after for _, after, _ in kept], axis=1)
            moment = np.concatenate([m for _, _, m in kept], axis=1)
        return boxes

    def angles(self, boxes: _Boxes, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Intervals of all angles, shape (2, n, m), and which boxes may hold an equilibrium."""
        direction, moment = boxes.phi, np.full_like(boxes.phi, self.torque)
        q, fine = np.zeros_like(boxes.angles), np.ones(boxes.phi.shape[1], bool)
        for i in reversed(range(self.n)):
            moment = self.moment(i, direction, moment)
            for k in range(len(self.curves[i])):
                index = np.flatnonzero((boxes.choice[i] == k) & fine)
                if len(index):
                    q[:, i, index], there = self.angle(i, k, moment[:, index], boxes.angles[:, i, index], steps)
                    fine[index] &= there
            direction = np.stack([direction[0] - q[1, i], direction[1] - q[0, i]])
            fine &= (direction[0] <= i * self.limit) & (direction[1] >= -i * self.limit)
        return q, fine & (direction[0] <= self.slop) & (direction[1] >= -self.slop)

    def divided(self, boxes: _Boxes) -> _Boxes:
        """Boxes divided along the widest of their intervals."""
        slack = self._is_slack(boxes)
        widths = np.concatenate(
            [(boxes.phi[1] - boxes.phi[0])[None], np.where(slack, np.diff(boxes.angles, axis=0)[0], 0)]
        )
        along = widths.argmax(axis=0)
        parts = []
        for part in range(_PARTS):
            phi, angles = boxes.phi.copy(), boxes.angles.copy()
            for axis in range(self.n + 1):
                index = np.flatnonzero(along == axis)
                sides = phi[:, index] if axis == 0 else angles[:, axis - 1, index]
                cut = np.stack([sides[0] + (sides[1] - sides[0]) * share / _PARTS for share in (part, part + 1)])
                if axis == 0:
                    phi[:, index] = cut
                else:
                    angles[:, axis - 1, index] = cut
            parts.append(_Boxes(phi, boxes.choice.copy(), angles))
        return _joined(parts)

    def is_small(self, boxes: _Boxes) -> np.ndarray:
        """Which boxes need not be divided any more."""
        free = np.where(self._is_slack(boxes), np.diff(boxes.angles, axis=0)[0], 0.0)
        return np.asarray((boxes.phi[1] - boxes.phi[0] < _SMALL) & (free < _SMALL).all(axis=0))

    def _is_slack(self, boxes: _Boxes) -> np.ndarray:
        table = [np.array([curve.slack is not None for curve in curves]) for curves in self.curves]
        return np.stack([row[choice] for row, choice in zip(table, boxes.choice, strict=True)])


def _joined(parts: Sequence[_Boxes]) -> _Boxes:
    return _Boxes(*(np.concatenate(values, axis=-1) for values in zip(*parts, strict=True)))


def candidates(arm: DualTriangleStatics, free_lengths: Sequence[float], load: Sequence[float]) -> np.ndarray:
    """Configurations next to every equilibrium, shape (n, any number).

    Without a load the segments do not know of one another. Where too many boxes may hold an equilibrium (they form a
    continuum, or nearly so), points of these boxes are given, which need not lead to all.
    """
    if not any(load):
        pairs = zip(free_lengths[::2], free_lengths[1::2], strict=True)
        each = [[e.configuration[0] for e in one.equilibria(p)] for one, p in zip(arm.chain, pairs, strict=True)]
        return np.array(list(product(*each))).reshape(-1, arm.segments).T
    shooter = _Shooter(arm, free_lengths, load)
    boxes, found, steps = shooter.seed(), [np.empty((arm.segments, 0))], 1
    while boxes.phi.shape[1]:
        q, fine = shooter.angles(boxes, steps)
        small = shooter.is_small(boxes) & fine
        found += [q[:, :, small].mean(axis=0)]
        rest = boxes.take(np.flatnonzero(fine & ~small))
        if rest.phi.shape[1] * _PARTS > _MOST_BOXES:
            middles = q[:, :, fine & ~small].mean(axis=0)
            found.append(middles[:, :: -(-middles.shape[1] // _MOST_POINTS)])
            break
        boxes = shooter.divided(rest)
        steps = min(steps + 2, 12)
    return _thinned(np.concatenate(found, axis=1))


def _thinned(points: np.ndarray) -> np.ndarray:
    """One of all points that are next to one another: boxes around an equilibrium come in clusters."""
    _, index = np.unique(np.round(points / (10 * _SMALL)), axis=1, return_index=True)
    return points[:, index]


def polish(
    arm: DualTriangleStatics, free_lengths: Sequence[float], load: Sequence[float], points: np.ndarray
) -> np.ndarray:
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
    size = scale + np.hypot(load[0], load[1]) * arm.reach + sum(abs(torque) for torque in load[2:])
    good = np.linalg.norm(gradient, axis=1) <= 1e-11 * size
    good &= np.abs(points).max(axis=0) < limit - 1e-11
    distinct: list[np.ndarray] = []
    for point in points[:, good].T:
        if not any(np.abs(point - other).max() < 1e-6 for other in distinct):
            distinct.append(point)
    return np.array(sorted(distinct, key=tuple)).reshape(-1, n).T


def grid_of_starts(arm: DualTriangleStatics) -> np.ndarray:
    """Starts all over the box of angles, for cables: where both are slack the chain of moments breaks."""
    limit, n = float(arm.design.joint_limit), arm.segments
    count = max(3, round(4000 ** (1 / n))) if n < 7 else 2
    axis = np.linspace(-0.97, 0.97, count) * limit
    return np.array(np.meshgrid(*[axis] * n, indexing="ij")).reshape(n, -1)
