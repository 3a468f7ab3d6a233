"""Aspects of a planar mechanism, and changes of posture within one aspect, which meet no singularity.

An *aspect* is a connected set of configurations without a singularity; a mechanism is *cuspidal* if two inverse
solutions of one point lie in one aspect [Furet2018, section 4]. See `singularity` for the curves between aspects.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.geometry.overlay import winding_numbers
from tensegrity_envs.geometry.singularity import Planar, Scalar, components, gradient

_LONGEST = 0.05  # [rad] between samples of a segment
_SAFETY = 1.5  # second derivatives between samples may be larger than at them by this factor


@dataclass(frozen=True)
class _Grid:
    """Nodes of a joint space, which of them may be joined, and f there.

    Two neighbours are joined only where f keeps its sign between them: on a segment of length d it cannot fall below
    the smaller end value by more than c d^2 / 8, with c a bound of its second derivatives.
    """

    axes: tuple[np.ndarray, np.ndarray]
    values: np.ndarray
    curvature: np.ndarray  # such a bound around each node
    period: float | None

    @property
    def steps(self) -> tuple[float, float]:
        return self.axes[0][1] - self.axes[0][0], self.axes[1][1] - self.axes[1][0]

    def edges(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """First and second node of every safe edge (flat indices), and its length."""
        n1, n2 = self.values.shape
        index = np.arange(n1 * n2).reshape(n1, n2)
        h1, h2 = self.steps
        found = []
        for i, j in ((1, 0), (0, 1), (1, 1), (1, -1)):
            other = np.roll(index, (-i, -j), axis=(0, 1))
            length = math.hypot(i * h1, j * h2)
            v, w = self.values, self.values.ravel()[other]
            bound = np.maximum(self.curvature, self.curvature.ravel()[other])
            good = (np.sign(v) == np.sign(w)) & (np.minimum(np.abs(v), np.abs(w)) > bound * length**2 / 8)
            if self.period is None:
                if i:
                    good[-1:, :] = False
                if j:
                    good[:, -1 if j > 0 else 0] = False
            found.append((index[good], other[good], np.full(int(good.sum()), length)))
        first, second, lengths = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return first, second, lengths


def _grid(f: Scalar, limit: float, period: float | None, resolution: int) -> _Grid:
    from scipy.ndimage import maximum_filter  # slow to import, and only needed here

    axis: np.ndarray = np.linspace(-limit, limit, resolution)
    if period is not None:
        axis = -period / 2 + period / resolution * (np.arange(resolution) + 0.5)
    rows, columns = axis[:, None], axis[None, :]  # sines and cosines of each are taken once
    values = np.array(np.broadcast_to(f((rows, columns)), (len(axis), len(axis))))
    local = _curvature(f, rows, columns)
    around = maximum_filter(
        np.broadcast_to(local, values.shape), size=3, mode="wrap" if period is not None else "nearest"
    )
    return _Grid((axis, axis), values, _SAFETY * around, period)


def _curvature(f: Scalar, q1: np.ndarray, q2: np.ndarray) -> np.ndarray:
    """Largest second derivative of f in any direction, by differences, at configurations (q1, q2), broadcast."""
    h = 1e-3
    value = {(i, j): np.asarray(f((q1 + i * h, q2 + j * h))) for i in (-1, 0, 1) for j in (-1, 0, 1)}
    d11, d22 = (value[step] - 2 * value[0, 0] + value[-step[0], -step[1]] for step in ((1, 0), (0, 1)))
    d12 = (value[1, 1] - value[1, -1] - value[-1, 1] + value[-1, -1]) / 4
    return np.asarray(np.abs(d11 + d22) / 2 + np.hypot((d11 - d22) / 2, d12)) / h**2


@dataclass(frozen=True)
class Aspects:
    """Connected sets of configurations without a singularity.

    Attributes:
        labels: shape (n, n), number of the aspect of each node of a grid of (q1, q2), -1 next to a singularity.
        axes: of the grid.
        signs: of det J in each aspect.
        areas: of each aspect in joint space, from the grid [rad2].
    """

    labels: np.ndarray
    axes: tuple[np.ndarray, np.ndarray]
    signs: tuple[int, ...]
    areas: tuple[float, ...]

    @property
    def count(self) -> int:
        """Number of aspects."""
        return len(self.signs)


def aspects(mechanism: Planar, limit: float, period: float | None = None, resolution: int = 400) -> Aspects:
    """The aspects in the box |q_i| <= limit, or on the torus of the given period, largest first.

    Aspects with less than a thousandth of the joint space are left out: next to a singularity the grid cannot tell.
    """
    from scipy.sparse import coo_array  # slow to import, and only needed here
    from scipy.sparse.csgraph import connected_components

    grid = _grid(mechanism.jacobian_determinant, limit, period, resolution)
    first, second, _ = grid.edges()
    n = grid.values.size
    _, label = connected_components(coo_array((np.ones(len(first)), (first, second)), shape=(n, n)), directed=False)
    sizes = np.bincount(label)
    kept = [k for k in np.argsort(-sizes) if sizes[k] > n / 1000]
    cell = float(grid.steps[0] * grid.steps[1])
    renamed = np.full(len(sizes), -1)
    renamed[kept] = np.arange(len(kept))
    values = grid.values.ravel()
    signs = tuple(int(np.sign(values[np.flatnonzero(label == k)[0]])) for k in kept)
    return Aspects(
        renamed[label].reshape(grid.values.shape), grid.axes, signs, tuple(float(sizes[k]) * cell for k in kept)
    )


@dataclass(frozen=True)
class PosturePath:
    """A path between two configurations of one aspect.

    Attributes:
        configurations: shape (n, 2) [rad], from the start; continuous, so that on a torus the last one may differ from
            the goal by whole periods.
        tips: shape (n, 2) [m].
        singularity: det J along it, shape (n,), of one sign.
    """

    configurations: np.ndarray
    tips: np.ndarray
    singularity: np.ndarray

    @property
    def clearance(self) -> float:
        """The smallest |det J| at its points."""
        return float(np.abs(self.singularity).min())

    def encircled(self, points: Sequence[tuple[float, float]]) -> list[int]:
        """How often the tip runs around each point, counter-clockwise positive, if start and goal share their tip."""
        return [int(n) for n in winding_numbers([self.tips[:-1]], np.array(points, float).reshape(-1, 2))]


def posture_change(
    mechanism: Planar,
    start: tuple[float, float],
    goal: tuple[float, float],
    limit: float,
    period: float | None = None,
    longest_step: float = 0.05,
    resolution: int = 240,
) -> PosturePath:
    """A path from start to goal that never meets det J = 0.

    The cheapest path on a grid of the joint space, where being close to a singularity costs; shortened where safe.
    Every piece of it is checked with second derivatives of det J (from samples, with a margin of a half): between its
    ends det J cannot reach zero. Where no path is found the grid is made twice as fine, twice.

    Args:
        mechanism: planar.
        start, goal: configurations [rad]; mostly two inverse solutions of one tip position.
        limit: |q_i| <= limit along the path [rad].
        period: of the joint angles [rad] where they can turn full circle, instead of the limit.
        longest_step: between neighbouring points of the path [rad], in each angle.
        resolution: of the grid along each angle, to begin with.

    Raises:
        ValueError: start or goal is singular or outside the limits, or they are in different aspects (or the way
            between them is narrower than the grid can see).
    """
    f = mechanism.jacobian_determinant
    ends = [np.array(start, float), np.array(goal, float)]
    values = [float(f((float(q[0]), float(q[1])))) for q in ends]
    for name, q, value in zip(("start", "goal"), ends, values, strict=True):
        if not np.isfinite(q).all():
            raise ValueError(f"{name} = {tuple(q)}: must be finite numbers")
        if period is None and np.abs(q).max() > limit:
            raise ValueError(f"{name} = {tuple(q)}: outside the joint limit {limit:g}")
        if abs(value) < 1e-12 * mechanism.reach**2:
            raise ValueError(f"{name} = {tuple(q)}: singular, det J = {value:.1e}")
    if values[0] * values[1] < 0:
        raise ValueError(f"start and goal are in different aspects: det J is {values[0]:.3g} and {values[1]:.3g}")
    sign = math.copysign(1.0, values[0])

    def height(q: Sequence[Component]) -> Component:
        return sign * f(q)

    for finer in (1, 2, 4):
        points = _way(height, ends, _grid(height, limit, period, finer * resolution))
        if points is not None:
            break
    else:
        raise ValueError("start and goal are in different aspects: no way between them without a singularity was found")
    if period is not None:  # continuous instead of wrapped
        jumps = np.diff(points, axis=0)
        points[1:] = points[0] + np.cumsum(jumps - period * np.round(jumps / period), axis=0)
    points = _shorten(height, points)
    pieces = [points[:1]]
    for p, q in itertools.pairwise(points):
        count = max(1, math.ceil(float(np.abs(q - p).max()) / longest_step))
        pieces.append(p + (q - p) * (np.arange(1, count + 1) / count)[:, None])
    path = np.concatenate(pieces)
    q1, q2 = components(path)
    return PosturePath(path, np.stack(mechanism.tip((q1, q2)), axis=1), np.asarray(f((q1, q2))))


def _way(f: Scalar, ends: list[np.ndarray], grid: _Grid) -> np.ndarray | None:
    """The cheapest way over nodes of the grid where f > 0, ends included; None where there is none."""
    from scipy.sparse import coo_array  # slow to import, and only needed here
    from scipy.sparse.csgraph import dijkstra

    leads = [_climb(f, q, grid) for q in ends]
    start, goal = (_nearest(f, lead[-1], grid) for lead in leads)
    if start is None or goal is None:
        return None
    first, second, length = grid.edges()
    values = grid.values.ravel()
    up = (values[first] > 0) & (values[second] > 0)
    first, second, length = first[up], second[up], length[up]
    wanted = 0.1 * values.max()
    cost = length * (1 + (wanted / values[first]) ** 2 + (wanted / values[second]) ** 2)
    graph = coo_array((cost, (first, second)), shape=(values.size, values.size)).tocsr()
    distance, before = dijkstra(graph, directed=False, indices=np.array([start]), return_predecessors=True)
    if not np.isfinite(distance[0, goal]):
        return None
    way = [goal]
    while way[-1] != start:
        way.append(int(before[0, way[-1]]))
    n = len(grid.axes[1])
    middle = np.array([[grid.axes[0][k // n], grid.axes[1][k % n]] for k in reversed(way)])
    return np.concatenate([leads[0], middle, leads[1][::-1]])


def is_free(f: Scalar, p: np.ndarray, q: np.ndarray, floor: float = 0.0) -> bool:
    """Whether f > floor on the whole segment from p to q.

    By samples, and second derivatives at the samples for what lies between: thorough, not a proof.
    """
    length = float(np.hypot(*(q - p)))
    count = max(4, math.ceil(length / _LONGEST))
    for _ in range(5):
        points = p + np.linspace(0, 1, count + 1)[:, None] * (q - p)
        values = np.asarray(f(components(points)))
        if values.min() <= floor:
            return False
        bend = _SAFETY * _curvature(f, points[..., 0], points[..., 1])
        drop = np.maximum(bend[1:], bend[:-1]) * (length / count) ** 2 / 8
        if (np.minimum(values[1:], values[:-1]) - drop > floor).all():
            return True
        count *= 4
    return False


def _climb(f: Scalar, q: np.ndarray, grid: _Grid) -> np.ndarray:
    """From q uphill, in safe steps, until f is large enough for the grid; the points on the way."""
    longest = grid.steps[0] ** 2 + grid.steps[1] ** 2
    points = [q]
    for _ in range(200):
        value = float(np.asarray(f((points[-1][:1], points[-1][1:])))[0])
        curvature = _SAFETY * float(_curvature(f, *points[-1])) + 1e-9
        if value > curvature * longest:
            break
        slope = gradient(f, points[-1])
        step = min(0.5 * min(grid.steps), math.sqrt(2 * value / curvature))
        points.append(points[-1] + slope * step / max(float(np.hypot(*slope)), 1e-300))
        if grid.period is None:
            points[-1] = np.clip(points[-1], grid.axes[0][0], grid.axes[0][-1])
    return np.array(points)


def _nearest(f: Scalar, q: np.ndarray, grid: _Grid) -> int | None:
    """Flat index of a node that can be reached from q in a straight line; None where there is none."""
    n = len(grid.axes[0])
    place = [(q[k] - grid.axes[k][0]) / grid.steps[k] for k in (0, 1)]
    offsets = sorted(
        itertools.product(range(-2, 4), repeat=2),
        key=lambda o: sum((math.floor(p) + d - p) ** 2 for p, d in zip(place, o, strict=True)),
    )
    for offset in offsets:
        i, j = (math.floor(p) + d for p, d in zip(place, offset, strict=True))
        if grid.period is None and not (0 <= i < n and 0 <= j < n):
            continue
        node = np.array([grid.axes[0][0] + i * grid.steps[0], grid.axes[1][0] + j * grid.steps[1]])
        if grid.values[i % n, j % n] > 0 and is_free(f, q, node):
            return int((i % n) * n + j % n)
    return None


def _shorten(f: Scalar, points: np.ndarray) -> np.ndarray:
    """Straight lines instead of detours, where f stays close to its least value there, or to a tenth of its largest."""
    height = np.asarray(f(components(points)))
    top = 0.1 * float(height.max())
    kept, i = [0], 0
    while i < len(points) - 1:
        j = len(points) - 1
        while j > i + 1:
            floor = 0.8 * min(float(height[i : j + 1].min()), top)
            if is_free(f, points[i], points[j], floor):
                break
            j = i + max(1, (j - i) // 2) if j - i > 64 else j - 1
        kept.append(j)
        i = j
    return points[kept]
