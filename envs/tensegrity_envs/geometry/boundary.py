"""The boundary of a region as closed polygons: from a grid's topology to exact, refined curves."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.geometry.conditions import LIMIT, Conditions
from tensegrity_envs.mechanics.roots import bracketed_roots

Map = Callable[[tuple[np.ndarray, np.ndarray]], tuple[Component, Component]]

PI = math.pi
_RESIDUAL = 1e-10  # of every boundary point, in units of the margin
_ROUNDS = 12  # of halving the chords
_NEWTON = 8


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

    region: Conditions
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


def outlines(margin: np.ndarray) -> tuple[list[np.ndarray], list[int]]:
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


def trace(
    region: Conditions,
    grids: list[np.ndarray],
    margin: np.ndarray,
    rings: list[np.ndarray],
    shape: list[int],
    tolerance: float,
    image: Map | None,
) -> Traced:
    """The rings of `outlines`, on a grid of these margins, as exact curves; see `Region.trace`."""
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
    region: Conditions, grids: list[np.ndarray], margin: np.ndarray, crossing: np.ndarray
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


def _add_corners(region: Conditions, curves: _Curves, cell: float) -> None:
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


def _on_edge(region: Conditions, points: np.ndarray) -> np.ndarray:
    return np.asarray(((points == np.array(region.lower)) | (points == np.array(region.upper))).any(axis=1))


def _refine(region: Conditions, curves: _Curves, tolerance: float, image: Map | None) -> None:
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
    region: Conditions, condition: np.ndarray, middle: np.ndarray, normal: np.ndarray, length: np.ndarray, edge: int
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


def _assemble(region: Conditions, curves: _Curves, shape: list[int], resolution: int) -> Traced:
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
