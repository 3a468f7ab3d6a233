"""Regions of a plane given by continuous margins: slices, boundary curves as closed polygons, components, areas.

Nothing here knows a mechanism. A `Region` is the part of a box in which several margins are positive; its plane may be
a joint space, a space of inputs, or any other. The boundary is not read off a grid: the grid only tells the topology.
Every vertex is a root of the condition that is active there, every corner a common root of two of them, and the
curves between are refined until their chords are as close as asked.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.roots import bracketed_roots, hidden_sign_changes
from tensegrity_envs.mechanics.slivers import missed

Map = Callable[[tuple[np.ndarray, np.ndarray]], tuple[Any, Any]]

LIMIT = "limit"  # the name of the box's edge among the conditions
PI = math.pi
_RESIDUAL = 1e-10  # of every boundary point, in units of the margin
_ROUNDS = 12  # of halving the chords
_NEWTON = 8
_FEWEST = 12  # crossings of grid edges by one ring


class Interval(NamedTuple):
    """A maximal interval of a slice, and the conditions that end it: names of conditions, or "limit" for the box."""

    low: float
    high: float
    low_condition: str
    high_condition: str


class BoundaryPoints(NamedTuple):
    """Boundary points found along grid lines.

    Attributes:
        points: shape (n, 2).
        conditions: n names of what is active there.
        fixed: shape (n,), the coordinate (0 or 1) that was constant on the line.
    """

    points: np.ndarray
    conditions: list[str]
    fixed: np.ndarray


@dataclass(frozen=True)
class Region:
    """The part of a box in which all margins are positive.

    Attributes:
        conditions: (q1, q2) -> margins, one for each name, elementwise on arrays of one shape; positive inside.
        names: of the conditions.
        lower, upper: corners of the box.
        what: in words, for exports.
        least: (q1, q2) -> the smallest of the margins, where that is cheaper than all of them.
    """

    conditions: Callable[[Any, Any], Sequence[Component]]
    names: tuple[str, ...]
    lower: tuple[float, float]
    upper: tuple[float, float]
    what: str = "region"
    least: Callable[[Any, Any], Component] | None = None

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: the box is empty or not finite, or a name is used twice.
        """
        if not all(math.isfinite(v) for v in (*self.lower, *self.upper)):
            raise ValueError(f"box {self.lower} ... {self.upper}: must be finite")
        if not (self.lower[0] < self.upper[0] and self.lower[1] < self.upper[1]):
            raise ValueError(f"box {self.lower} ... {self.upper}: each upper bound must be above the lower one")
        if len(set(self.names)) != len(self.names) or LIMIT in self.names:
            raise ValueError(f"condition names {self.names}: must differ from one another and from {LIMIT!r}")

    @property
    def box_area(self) -> float:
        """Area of the box."""
        return (self.upper[0] - self.lower[0]) * (self.upper[1] - self.lower[1])

    def margins(self, q1: Component, q2: Component) -> np.ndarray:
        """All margins, shape (number of conditions, ...); -1 where one is not a number."""
        q1, q2 = np.broadcast_arrays(np.asarray(q1, float), np.asarray(q2, float))
        with np.errstate(all="ignore"):
            values = np.stack([np.broadcast_to(v, q1.shape) for v in self.conditions(q1, q2)])
        np.nan_to_num(values, copy=False, nan=-1.0, posinf=1e300, neginf=-1e300)
        return values

    def margin(self, q1: Component, q2: Component) -> np.ndarray:
        """The smallest margin, positive inside and continuous; the box is not part of it."""
        if self.least is None:
            return np.asarray(self.margins(q1, q2).min(axis=0))
        with np.errstate(all="ignore"):
            value = np.asarray(self.least(np.asarray(q1, float), np.asarray(q2, float)))
        return np.where(np.isnan(value), -1.0, value)

    def active(self, q1: Component, q2: Component) -> np.ndarray:
        """Index of the condition with the smallest margin."""
        return np.asarray(self.margins(q1, q2).argmin(axis=0))

    def contains(self, q1: Component, q2: Component) -> np.ndarray:
        """Whether points are inside, the box included."""
        inside = self.margin(q1, q2) > 0
        for q, low, high in zip((q1, q2), self.lower, self.upper, strict=True):
            inside = inside & (np.asarray(q) >= low) & (np.asarray(q) <= high)
        return np.asarray(inside)

    def with_condition(self, name: str, margin: Callable[[Any, Any], Component]) -> "Region":
        """The part of this region in which one more margin is positive."""
        return replace(
            self,
            conditions=lambda q1, q2: (*self.conditions(q1, q2), margin(q1, q2)),
            names=(*self.names, name),
            least=lambda q1, q2: np.minimum(self.margin(q1, q2), margin(q1, q2)),
        )

    # ------------------------------------------------------------------------------------------------------ slices

    def slices(self, fixed: int, values: Any, samples: int = 129) -> list[list[Interval]]:
        """All intervals of the region on lines along one coordinate.

        Sampled, with a search for sign changes between samples (`roots.hidden_sign_changes`), then every end is
        found to the last bits. An interval is missed only if it lies between two samples that do not
        rise towards it.

        Args:
            fixed: the coordinate, 0 or 1, that is constant on each line.
            values: its value for each line, shape (lines,).
            samples: along each line.

        Returns:
            For each line its intervals in increasing order, an empty list where there is none.

        Raises:
            ValueError: fixed is neither 0 nor 1, or a value is not a finite number within the box.
        """
        if fixed not in (0, 1):
            raise ValueError(f"fixed = {fixed!r}: must be 0 or 1, the coordinate that is constant on the lines")
        lines = np.atleast_1d(np.asarray(values, float))
        low, high = self.lower[fixed], self.upper[fixed]
        if not np.all((lines >= low) & (lines <= high)):
            raise ValueError(f"values = {values!r}: must lie in [{low:g}, {high:g}]")
        return self._slices(np.full(len(lines), fixed), lines, samples)

    def _slices(self, fixed: np.ndarray, lines: np.ndarray, samples: int) -> list[list[Interval]]:
        """Intervals on lines, each with its own fixed coordinate."""
        first = fixed == 0

        def at(line: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            value, is_first = lines[line], first[line]
            return np.where(is_first, value, s), np.where(is_first, s, value)

        def margin(line: np.ndarray, s: np.ndarray) -> np.ndarray:
            return self.margin(*at(line, s))

        share = np.linspace(0.0, 1.0, samples)
        low = np.where(first, self.lower[1], self.lower[0])[:, None]
        s = low + (np.where(first, self.upper[1], self.upper[0])[:, None] - low) * share
        s[:, -1] = np.where(first, self.upper[1], self.upper[0])
        index = np.arange(len(lines))
        sampled = np.empty(s.shape)
        for k in np.unique(fixed):  # a coordinate that is constant on its line is evaluated once
            mine = np.flatnonzero(fixed == k)
            constant, along = lines[mine][:, None], s[mine[0]][None, :]
            sampled[mine] = self.margin(*((constant, along) if k == 0 else (along, constant)))
        inside = sampled > 0
        # Brackets (line, outer or inner end, other end): between samples that differ, and around hidden changes.
        line, i = np.nonzero(inside[:, 1:] != inside[:, :-1])
        begin, end = s[line, i], s[line, i + 1]
        hidden, x = hidden_sign_changes(margin, s, sampled)
        if len(hidden):
            line = np.concatenate([np.repeat(index, samples), hidden])
            place = np.concatenate([s.ravel(), x])
            flags = np.concatenate([inside.ravel(), margin(hidden, x) > 0])
            order = np.lexsort((place, line))
            line, place, flags = line[order], place[order], flags[order]
            change = np.flatnonzero((flags[1:] != flags[:-1]) & (line[1:] == line[:-1]))
            line, begin, end = line[change], place[change], place[change + 1]
        roots = bracketed_roots(lambda t: margin(line, t), begin, end)
        active = self.active(*at(line, roots))
        ends: list[list[tuple[float, str]]] = [[] for _ in lines]
        for k in np.flatnonzero(inside[:, 0]):
            ends[k].append((float(s[k, 0]), LIMIT))
        for k, root, condition in zip(line.tolist(), roots.tolist(), active.tolist(), strict=True):
            ends[k].append((root, self.names[condition]))
        for k in np.flatnonzero(inside[:, -1]):
            ends[k].append((float(s[k, -1]), LIMIT))
        return [
            [Interval(a, b, name_a, name_b) for (a, name_a), (b, name_b) in zip(found[::2], found[1::2], strict=True)]
            for found in ends
        ]

    def scan(self, lines: int = 50, samples: int = 129) -> BoundaryPoints:
        """Boundary points on equally spaced grid lines in both directions, as a cloud.

        Args:
            lines: in each direction.
            samples: along each line, see `slices`.
        """
        fixed = np.repeat([1, 0], lines)
        values = np.concatenate([np.linspace(self.lower[k], self.upper[k], lines) for k in (1, 0)])
        points: list[tuple[float, float]] = []
        names: list[str] = []
        along: list[int] = []
        for k, value, intervals in zip(
            fixed.tolist(), values.tolist(), self._slices(fixed, values, samples), strict=True
        ):
            for interval in intervals:
                for end, name in zip(interval[:2], interval[2:], strict=True):
                    points.append((value, end) if k == 0 else (end, value))
                    names.append(name)
                    along.append(k)
        return BoundaryPoints(np.array(points).reshape(-1, 2), names, np.array(along, int))

    # ---------------------------------------------------------------------------------------------------- boundary

    def trace(
        self,
        resolution: int = 256,
        tolerance: float = 1e-6,
        image: Map | None = None,
        finest: int = 2048,
        lines: int = 64,
    ) -> "Traced":
        """The boundary as closed polygons.

        A grid tells which of its edges the boundary crosses; it is made twice as fine, up to `finest`, while a cell is
        ambiguous or a local extremum between its nodes has the other sign. The crossings are then found exactly,
        corners are added where two conditions meet, and chords are halved until the curve is within `tolerance` of
        them.

        Args:
            resolution: cells of the grid along each coordinate.
            tolerance: largest distance between curve and chord, relative to the size of the box; with `image` also
                in the image, relative to its size.
            image: a map of the plane; its curves are then as smooth as the region's own.
            finest: largest resolution.
            lines: in each direction, along which exact slices check what the grid may have missed; 0 for no check.

        Raises:
            ValueError: resolution or tolerance is out of range.
        """
        if resolution < 4 or not 0 < tolerance < 1:
            raise ValueError(f"resolution = {resolution}, tolerance = {tolerance}: need at least 4 cells, 0 < tol < 1")
        while True:
            grids = [np.linspace(low, high, resolution + 1) for low, high in zip(self.lower, self.upper, strict=True)]
            margin = self.margin(grids[0][None, :], grids[1][:, None])
            rings, shape = _outlines(margin)
            small = any(len(ring) < _FEWEST for ring in rings)
            if 2 * resolution > finest or not (small or self._is_too_coarse(margin, grids)):
                break
            resolution *= 2
        traced = _trace(self, grids, margin, rings, shape, tolerance, image)
        if not lines:
            return traced
        more = missed(self, traced.rings, max(float(g[1] - g[0]) for g in grids), lines, image)
        return replace(traced, area_error=max(traced.area_error, more.area), missed_in_image=more.image)

    def _is_too_coarse(self, margin: np.ndarray, grids: list[np.ndarray]) -> bool:
        positive = margin > 0
        diagonal = (positive[:-1, :-1] == positive[1:, 1:]) & (positive[:-1, 1:] == positive[1:, :-1])
        if (diagonal & (positive[:-1, :-1] != positive[:-1, 1:])).any():
            return True
        # Nodes where |margin| is smaller than around them, and slopes that would let it reach zero within a cell.
        size = np.abs(margin)
        padded = np.pad(size, 1, mode="edge")
        signs = np.pad(positive, 1, mode="edge")
        n2, n1 = size.shape
        least, rise, alike = np.ones(size.shape, bool), np.zeros(size.shape), np.ones(size.shape, bool)
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1), (2, 2)):
            neighbour = padded[i : i + n2, j : j + n1]
            least &= size <= neighbour
            rise = np.maximum(rise, neighbour - size)
            alike &= signs[i : i + n2, j : j + n1] == positive
        rows, columns = np.nonzero(least & alike & (size < rise))
        if not len(rows):
            return False
        fine = np.linspace(-1, 1, 13)
        h1, h2 = grids[0][1] - grids[0][0], grids[1][1] - grids[1][0]
        q1 = np.clip(grids[0][columns, None, None] + h1 * fine[None, :, None], self.lower[0], self.upper[0])
        q2 = np.clip(grids[1][rows, None, None] + h2 * fine[None, None, :], self.lower[1], self.upper[1])
        inside = self.margin(*np.broadcast_arrays(q1, q2)) > 0
        return bool((inside != positive[rows, columns][:, None, None]).any())


class Ring(NamedTuple):
    """A closed boundary curve; outer ones run counter-clockwise, holes clockwise.

    Attributes:
        points: shape (n, 2); the last point is joined to the first.
        conditions: shape (n,), index of the condition that is active between point i and the next one; that of the
            box's edge is the number of conditions, -1 where it was not resolved.
    """

    points: np.ndarray
    conditions: np.ndarray


class Component2D(NamedTuple):
    """A connected component: its outer boundary, its holes, and its area."""

    outer: Ring
    holes: tuple[Ring, ...]
    area: float

    @property
    def rings(self) -> tuple[Ring, ...]:
        """Outer boundary and holes."""
        return (self.outer, *self.holes)


@dataclass(frozen=True)
class Traced:
    """A region's boundary: components, largest first (none for an empty region), and area.

    Attributes:
        region: that was traced.
        components: of it.
        area: chords' polygons and the segments between chords and curves.
        area_error: estimate: those segments, added without regard to their sign, and more where the boundary could not
            be resolved; or what lines between those of the grid have found missing or too much (`slivers.py`), if that
            is more.
        missed_in_image: the latter, in the image of the map that the boundary was traced for [its units squared].
        resolution: cells of the grid along each coordinate.
    """

    region: Region
    components: tuple[Component2D, ...]
    area: float
    area_error: float
    resolution: int
    missed_in_image: float = 0.0

    @property
    def is_empty(self) -> bool:
        """Whether the region has no point."""
        return not self.components

    @property
    def fraction(self) -> float:
        """Area as a fraction of the box."""
        return self.area / self.region.box_area

    @cached_property
    def rings(self) -> list[Ring]:
        """All boundary curves."""
        return [ring for component in self.components for ring in component.rings]

    def lengths(self) -> dict[str, float]:
        """Length of the boundary by active condition."""
        found = dict.fromkeys((*self.region.names, LIMIT, "unresolved"), 0.0)
        names = (*self.region.names, LIMIT, "unresolved")
        for ring in self.rings:
            step = np.hypot(*(np.roll(ring.points, -1, axis=0) - ring.points).T)
            for k, name in enumerate(names):
                found[name] += float(step[ring.conditions == (k if k < len(names) - 1 else -1)].sum())
        return found

    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """((smallest q1, q2), (largest q1, q2)); None for an empty region."""
        if self.is_empty:
            return None
        points = np.concatenate([ring.points for ring in self.rings])
        (x0, y0), (x1, y1) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        return (x0, y0), (x1, y1)

    def to_features(self, **properties: Any) -> list[dict[str, Any]]:
        """GeoJSON features, one for each component, in the region's own coordinates."""
        return [
            {
                "type": "Feature",
                "geometry": {
                    "type": "Polygon",
                    "coordinates": [[*ring.points.tolist(), ring.points[0].tolist()] for ring in component.rings],
                },
                "properties": {"region": self.region.what, "component": k, "area": component.area} | properties,
            }
            for k, component in enumerate(self.components)
        ]


def signed_area(points: np.ndarray) -> float:
    """Area of a closed polygon, shape (n, 2), positive counter-clockwise."""
    x, y = (points - points.mean(axis=0)).T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


# ------------------------------------------------------------------------------------------------------------ tracing


class _Curves:
    """All rings at once as flat arrays: points, condition of the segment that begins there, ring."""

    def __init__(self, points: np.ndarray, conditions: np.ndarray, ring: np.ndarray) -> None:
        self.points, self.conditions, self.ring = points, conditions, ring
        self.open = np.ones(len(points), bool)  # segments that may have to be halved
        self.bulge = np.zeros(len(points))  # area between the segment's chord and the curve, signed

    def following(self) -> np.ndarray:
        """Index of the point after each point, around its ring."""
        nxt = np.arange(1, len(self.ring) + 1)
        last = np.flatnonzero(np.append(self.ring[1:] != self.ring[:-1], True))
        first = np.append(0, last[:-1] + 1)
        nxt[last] = first
        return nxt

    def insert(
        self, after: np.ndarray, points: np.ndarray, conditions: np.ndarray, open_: np.ndarray, bulge: np.ndarray
    ) -> None:
        """New points, each after the given one (increasing)."""
        at = after + 1
        self.points = np.insert(self.points, at, points, axis=0)
        self.conditions = np.insert(self.conditions, at, conditions)
        self.ring = np.insert(self.ring, at, self.ring[after])
        self.open = np.insert(self.open, at, open_)
        self.bulge = np.insert(self.bulge, at, bulge)


def _outlines(margin: np.ndarray) -> tuple[list[np.ndarray], list[int]]:
    """Rings of crossed grid edges' middles, in cells, outer ones before their holes; and rings of each component."""
    from contourpy import FillType, contour_generator  # slow to import, and only needed here

    # Only signs count: every crossing is then at the middle of a grid edge. A rim of outside closes the curves.
    signs = np.full((margin.shape[0] + 2, margin.shape[1] + 2), -1.0)
    signs[1:-1, 1:-1] = np.where(margin > 0, 1.0, -1.0)
    rings: list[np.ndarray] = []
    shape = []
    filled = contour_generator(z=signs, fill_type=FillType.OuterOffset).filled(0.0, 2.0)
    for points, offsets in zip(*filled, strict=True):
        pieces = [np.asarray(points[i:j])[:-1] - 1.0 for i, j in itertools.pairwise(offsets)]
        shape.append(len(pieces))
        rings += pieces
    return rings, shape


def _trace(
    region: Region,
    grids: list[np.ndarray],
    margin: np.ndarray,
    rings: list[np.ndarray],
    shape: list[int],
    tolerance: float,
    image: Map | None,
) -> Traced:
    resolution = len(grids[0]) - 1
    if not rings:
        return Traced(region, (), 0.0, 0.0, resolution)
    crossing = np.concatenate(rings)
    owner = np.repeat(np.arange(len(rings)), [len(r) for r in rings])
    points, conditions = _crossings(region, grids, margin, crossing)
    curves = _Curves(points, conditions, owner)
    _add_corners(region, curves, max(g[1] - g[0] for g in grids))
    _refine(region, curves, tolerance, image)
    return _assemble(region, curves, shape, resolution)


def _crossings(
    region: Region, grids: list[np.ndarray], margin: np.ndarray, crossing: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Exact crossings of grid edges, and the condition active there (that of the edge of the box last)."""
    first, second = np.floor(crossing).astype(int), np.ceil(crossing).astype(int)
    top = len(grids[0]) - 1
    rim = ((first < 0) | (second > top)).any(axis=1)
    first, second = np.clip(first, 0, top), np.clip(second, 0, top)
    start = np.stack([grids[k][first[:, k]] for k in (0, 1)], axis=1)
    end = np.stack([grids[k][second[:, k]] for k in (0, 1)], axis=1)
    points = start.copy()
    inner = np.flatnonzero(~rim)
    a, step = start[inner], end[inner] - start[inner]
    t = bracketed_roots(
        lambda s: region.margin(a[:, 0] + s * step[:, 0], a[:, 1] + s * step[:, 1]),
        np.zeros(len(inner)),
        np.ones(len(inner)),
    )
    points[inner] = a + t[:, None] * step
    conditions = np.full(len(points), len(region.names))
    conditions[inner] = region.active(*points[inner].T)
    return points, conditions


def _add_corners(region: Region, curves: _Curves, cell: float) -> None:
    """Points where two conditions meet, between neighbours with different ones; and conditions of segments."""
    count = len(region.names)
    mine, nxt = curves.conditions, curves.following()
    theirs = mine[nxt]
    on_edge = _on_edge(region, curves.points) & _on_edge(region, curves.points[nxt])
    straight = (np.abs(curves.points[nxt] - curves.points) <= 1e-12 * cell).any(axis=1) & on_edge
    # A crossing that lies on the edge of the box is the corner between its own condition and the edge.
    touches = _on_edge(region, curves.points)
    same = np.where(mine == theirs, mine, -1)
    same = np.where((mine == count) & (theirs < count), theirs, same)
    same = np.where((theirs == count) & (mine < count), mine, same)
    segment = np.where(straight & ((mine == count) | (theirs == count) | (touches & touches[nxt])), count, same)
    k = np.flatnonzero((segment < 0) & (mine < count) & (theirs < count))
    curves.conditions = segment
    if not len(k):
        return
    a, b = mine[k], theirs[k]
    q = (curves.points[k] + curves.points[nxt[k]]) / 2
    start, rows = q.copy(), np.arange(len(k))

    def both(points: np.ndarray) -> np.ndarray:
        values = region.margins(points[:, 0], points[:, 1])
        return np.stack([values[a, rows], values[b, rows]], axis=1)

    h = 1e-6 * cell
    for _ in range(_NEWTON):
        value = both(q)
        if np.abs(value).max() < 1e-14:
            break
        columns = [(both(q + h * e) - both(q - h * e)) / (2 * h) for e in np.eye(2)]
        (d11, d21), (d12, d22) = columns[0].T, columns[1].T
        det = d11 * d22 - d12 * d21
        det = np.where(det == 0, np.inf, det)
        step = np.stack([d22 * value[:, 0] - d12 * value[:, 1], d11 * value[:, 1] - d21 * value[:, 0]], axis=1)
        step = step / det[:, None]
        length = np.hypot(*step.T)
        q = q - step * np.minimum(1.0, cell / np.maximum(length, 1e-300))[:, None]
        near = np.hypot(*(q - start).T) < 20 * cell
        if length[near].max(initial=0.0) < 1e-10 * cell:
            break
    value, least = both(q), region.margin(q[:, 0], q[:, 1])
    inside = np.all((q >= np.array(region.lower)) & (q <= np.array(region.upper)), axis=1)
    good = (np.abs(value).max(axis=1) < _RESIDUAL) & (least > -_RESIDUAL) & inside
    good &= np.hypot(*(q - start).T) < 6 * cell
    k, q, a, b = k[good], q[good], a[good], b[good]
    curves.conditions[k] = a
    curves.insert(k, q, b, np.ones(len(k), bool), np.zeros(len(k)))


def _on_edge(region: Region, points: np.ndarray) -> np.ndarray:
    return np.asarray(((points == np.array(region.lower)) | (points == np.array(region.upper))).any(axis=1))


def _refine(region: Region, curves: _Curves, tolerance: float, image: Map | None) -> None:
    """Halve chords, the new points on the active condition's curve, until the curve is close enough to them."""
    count = len(region.names)
    size = max(high - low for low, high in zip(region.lower, region.upper, strict=True))
    if image is not None:
        x, y = (np.asarray(v) for v in image((curves.points[:, 0], curves.points[:, 1])))
        image_size = max(float(np.ptp(x)), float(np.ptp(y)), 1e-300)
    for _ in range(_ROUNDS):
        nxt = curves.following()
        k = np.flatnonzero(curves.open & (curves.conditions >= 0))
        if not len(k):
            break
        p, q = curves.points[k], curves.points[nxt[k]]
        chord = q - p
        length = np.hypot(*chord.T)
        curves.open[k] = False
        real = length > 1e-9 * size
        k, p, q, chord, length = k[real], p[real], q[real], chord[real], length[real]
        if not len(k):
            break
        normal = np.stack([chord[:, 1], -chord[:, 0]], axis=1) / length[:, None]  # to the right: outside
        middle, good, sagitta = _onto_curve(region, curves.conditions[k], (p + q) / 2, normal, length, count)
        far = np.abs(sagitta) > tolerance * size
        if image is not None and len(k):
            stacked = np.concatenate([p, middle, q])
            mapped = np.stack([np.asarray(v) for v in image((stacked[:, 0], stacked[:, 1]))], axis=1)
            a, m, b = np.split(mapped, 3)
            far |= np.hypot(*(m - (a + b) / 2).T) > tolerance * image_size
        curves.conditions[k[~good & (curves.conditions[k] < count)]] = -1
        # Between curve and chord of a half there is an eighth of a parabola's segment, which is 2/3 sagitta x chord.
        part = sagitta * length / 12
        used = np.flatnonzero(good)
        curves.bulge[k[used]] = part[used]
        curves.open[k[used]] = far[used]
        curves.insert(k[used], middle[used], curves.conditions[k[used]], far[used], part[used])


def _onto_curve(
    region: Region, condition: np.ndarray, middle: np.ndarray, normal: np.ndarray, length: np.ndarray, edge: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of the conditions' curves on lines through `middle`; whether found, and how far they are from it."""
    rows = np.arange(len(middle))
    chosen = np.minimum(condition, edge - 1)

    def values(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        q = middle + t[:, None] * normal
        margins = region.margins(q[:, 0], q[:, 1])
        return margins[chosen, rows], margins.min(axis=0)

    t0, t1 = np.zeros(len(middle)), 1e-3 * length
    f0, f1 = values(t0)[0], values(t1)[0]
    least = f1
    for _ in range(_NEWTON):
        slope = (f1 - f0) / np.where(t1 == t0, np.inf, t1 - t0)
        t2 = np.where(slope == 0, t1, t1 - f1 / np.where(slope == 0, 1.0, slope))
        t2 = np.clip(t2, -0.4 * length, 0.4 * length)
        f2, least = values(t2)
        better = np.abs(f2) <= np.abs(f1)
        t0, f0 = np.where(better, t1, t0), np.where(better, f1, f0)
        t1, f1 = np.where(better, t2, t1), np.where(better, f2, f1)
        if (np.abs(t1 - t0) < 1e-9 * length).all():  # the error is of the order of the last two steps' product
            break
    _, least = values(t1)
    straight = condition == edge
    good = straight | ((np.abs(f1) < _RESIDUAL) & (least > -_RESIDUAL) & (np.abs(t1) < 0.39 * length))
    t1 = np.where(straight, 0.0, t1)
    return middle + t1[:, None] * normal, good, t1


def _assemble(region: Region, curves: _Curves, shape: list[int], resolution: int) -> Traced:
    # A crossing and a corner, or the two sides of a box corner, may be the same point.
    nxt = curves.following()
    keep = (curves.points[nxt] != curves.points).any(axis=1)
    rings, areas = [], []
    for k in range(sum(shape)):
        mine = np.flatnonzero((curves.ring == k) & keep)
        # The kept point of equal ones is the last: its segment is the one that leads away.
        ring = Ring(curves.points[mine], curves.conditions[mine])
        rings.append(ring)
        areas.append(signed_area(ring.points) + float(curves.bulge[mine].sum()) if len(mine) > 2 else 0.0)
    components, at = [], 0
    # The grid may see the thin end of a piece as islands. Their corners are all at the tip of the end, which the piece
    # itself reaches, so that nothing is left of them.
    least = 1e-3 * region.box_area / resolution**2
    for pieces in shape:
        if areas[at] > least:
            holes = tuple(ring for ring in rings[at + 1 : at + pieces] if len(ring.points) > 2)
            components.append(Component2D(rings[at], holes, sum(areas[at : at + pieces])))
        at += pieces
    components.sort(key=lambda component: -component.area)
    area = sum(component.area for component in components)
    unknown = curves.conditions < 0  # a curve that stays within a semicircle over its chord
    step = curves.points[nxt] - curves.points
    error = float(np.abs(curves.bulge).sum() + PI / 8 * (step[unknown] ** 2).sum())
    return Traced(region, tuple(components), area, error, resolution)
