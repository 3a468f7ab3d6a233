"""Signed clearance of planar arms from discs, convex polygons, walls and their own bars: exact between segments.

Derived here. The clearance of two convex bodies is their distance where they are apart, and minus the shortest
displacement that parts them where they overlap. Bodies are segments of no width; a disc has a radius, a polygon at
least three corners. Which pairs of an arm's own bars count, `own_bars` says.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import Component, namespace_of
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar

Point = tuple[Component, Component]
Segment = tuple[Point, Point]


@dataclass(frozen=True)
class Disc:
    """A disc.

    Attributes:
        centre: (x, y) [m].
        radius: [m].
    """

    centre: Point
    radius: Component

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: a number is not finite, or the radius is not positive.
        """
        if not (_is_pair(self.centre) and _are_finite(self.radius) and np.all(self.radius > 0)):
            raise ValueError(f"{self!r}: must have a centre (x, y) of finite numbers and a positive radius")
        object.__setattr__(self, "centre", tuple(self.centre))

    def clearance(self, segment: Segment) -> Component:
        """Of a segment [m]."""
        return point_distance(self.centre, segment) - self.radius

    def outline(self, far: float) -> list[Point]:
        """Corners of what to draw of it [m]; `far` is what is out of the picture."""
        angles = np.linspace(0, 2 * np.pi, _CORNERS, endpoint=False)
        return [(self.centre[0] + self.radius * np.cos(t), self.centre[1] + self.radius * np.sin(t)) for t in angles]


@dataclass(frozen=True)
class Polygon:
    """A convex polygon.

    Attributes:
        corners: (x, y) [m], counter-clockwise.
    """

    corners: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: there are fewer than three corners, or they are not those of a convex polygon in this order.
        """
        if not (np.iterable(self.corners) and all(map(_is_pair, self.corners)) and len(self.corners) >= 3):
            raise ValueError(f"{self!r}: must have three corners (x, y) or more, of finite numbers")
        points = np.array(self.corners, float)
        object.__setattr__(self, "corners", tuple(map(tuple, points.tolist())))
        edges = np.roll(points, -1, axis=0) - points
        after = np.roll(edges, -1, axis=0)
        turns = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
        angles = np.arctan2(turns, (edges * after).sum(axis=1))
        if not (turns > 0).all() or abs(angles.sum() - 2 * np.pi) > 1e-6:
            raise ValueError(
                f"{self!r}: corners must be those of a convex polygon, counter-clockwise, each of them once, and none "
                "on the line between two others"
            )

    def clearance(self, segment: Segment) -> Component:
        """Of a segment [m].

        Where they overlap, the shortest displacement is along a normal of an edge or of the segment (the normals of
        the edges of the Minkowski difference).
        """
        (ax, ay), (bx, by) = segment
        xp = namespace_of(ax, ay, bx, by)
        edges = list(zip(self.corners, (*self.corners[1:], self.corners[0]), strict=True))
        apart = reduce(xp.minimum, [segment_distance(edge, segment) for edge in edges])
        normals: list[Point] = [(q[1] - p[1], p[0] - q[0]) for p, q in edges]
        across = (by - ay, ax - bx)
        normals += [across, (-across[0], -across[1])]
        gaps = []
        for nx, ny in normals:
            own = namespace_of(nx, ny)  # of an edge's normal these may be floats where the segment is tensors
            extent = reduce(own.maximum, [nx * x + ny * y for x, y in self.corners])
            gap = xp.minimum(nx * ax + ny * ay, nx * bx + ny * by) - extent
            square = nx * nx + ny * ny
            gaps.append(own.where(square > 0, gap / own.sqrt(own.where(square > 0, square, 1.0)), _FAR_INSIDE))
        gap = reduce(xp.maximum, gaps)
        return xp.where(gap < 0, gap, apart)

    def outline(self, far: float) -> list[Point]:
        """See `Disc.outline`."""
        return list(self.corners)


@dataclass(frozen=True)
class Wall:
    """A half-plane that the arm must not enter.

    Attributes:
        point: (x, y) on the wall [m].
        normal: (x, y) of any length but zero, out of the wall.
    """

    point: tuple[float, float]
    normal: tuple[float, float]

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: a number is not finite, or the normal is zero.
        """
        if not (_is_pair(self.point) and _is_pair(self.normal) and any(self.normal)):
            raise ValueError(f"{self!r}: point and normal must be (x, y) of finite numbers, the normal not zero")
        for name in ("point", "normal"):
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))

    def clearance(self, segment: Segment) -> Component:
        """Of a segment [m]."""
        (ax, ay), (bx, by) = segment
        own = namespace_of(*self.normal)
        most = own.maximum(*map(abs, self.normal))  # so that no square overflows or vanishes
        nx, ny = (value / most for value in self.normal)
        size = own.sqrt(nx * nx + ny * ny)
        first, second = ((nx * (x - self.point[0]) + ny * (y - self.point[1])) / size for x, y in ((ax, ay), (bx, by)))
        return namespace_of(first, second).minimum(first, second)

    def outline(self, far: float) -> list[Point]:
        """See `Disc.outline`."""
        x, y, size = *self.point, np.hypot(*self.normal)
        nx, ny = far * self.normal[0] / size, far * self.normal[1] / size
        return [(x - ny, y + nx), (x + ny, y - nx), (x + ny - nx, y - nx - ny), (x - ny - nx, y + nx - ny)]


Obstacle = Disc | Polygon | Wall

_CORNERS = 72  # of a disc's outline
_FAR_INSIDE = -1e300  # [m]: what a bar of no length says of a normal that it does not have


def _are_finite(*numbers: Any) -> bool:
    try:
        return all(bool(np.isfinite(number).all()) for number in numbers)
    except TypeError:  # no numbers
        return False


def _is_pair(given: Any) -> bool:
    return np.iterable(given) and len(tuple(given)) == 2 and _are_finite(*given)


def point_distance(point: Point, segment: Segment) -> Component:
    """Distance of a point from a segment [m]."""
    (ax, ay), (bx, by) = segment
    dx, dy, px, py = bx - ax, by - ay, point[0] - ax, point[1] - ay
    xp = namespace_of(dx, dy, px, py)
    square = dx * dx + dy * dy
    share = (px * dx + py * dy) / namespace_of(square).where(square > 0, square, 1.0)
    share = xp.minimum(xp.maximum(share, 0.0), 1.0)
    return xp.hypot(px - share * dx, py - share * dy)


def segment_distance(first: Segment, second: Segment) -> Component:
    """Distance of two segments [m]; 0 where they cross."""
    (a, b), (c, d) = first, second
    ends = [point_distance(a, second), point_distance(b, second), point_distance(c, first), point_distance(d, first)]
    xp = namespace_of(*ends)
    crossed = (_side(a, b, c) * _side(a, b, d) < 0) & (_side(c, d, a) * _side(c, d, b) < 0)
    return xp.where(crossed, 0.0, reduce(xp.minimum, ends))


def _side(a: Point, b: Point, point: Point) -> Component:
    """On which side of the line from a to b a point is: the sign of twice the triangle's area."""
    return (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])


def check_obstacles(given: Any) -> None:
    """Raise TypeError unless this is None or a sequence of obstacles, which may be empty."""
    fine = given is None or (isinstance(given, list | tuple) and all(isinstance(one, Obstacle) for one in given))
    if not fine:
        raise TypeError(f"obstacles = {given!r}: must be a list or tuple of Disc, Polygon and Wall objects")


def check_one_each(obstacles: Sequence[Obstacle]) -> None:
    """Raise ValueError where a disc is many: where a number of it is an array."""
    for one in obstacles:
        if isinstance(one, Disc) and any(map(np.ndim, (*one.centre, one.radius))):
            raise ValueError(f"{one!r}: must be one disc, not many of them in arrays")


def bars_of(mechanism: Any, q: Sequence[Component], inputs: Any = None) -> dict[str, Segment]:
    """The bars of a planar mechanism in a configuration, by name: those of its members that keep their length.

    Raises:
        TypeError: it is no mechanism, or a spatial one, or its nodes need inputs.
    """
    if not (hasattr(mechanism, "nodes") and hasattr(mechanism, "members")):
        raise TypeError(f"mechanism = {mechanism!r}: must have nodes and members, such as NX(THREE_X)")
    if inputs is None and isinstance(mechanism, PlanarFourBar):
        raise TypeError(f"{type(mechanism).__name__}: its nodes depend on its lengths: give them as inputs")
    nodes = mechanism.nodes(q) if inputs is None else mechanism.nodes(q, inputs)
    if any(len(node) != 2 for node in nodes.values()):
        raise TypeError(f"{type(mechanism).__name__}: its nodes have three coordinates; this is for planar mechanisms")
    return {m.name: (nodes[m.nodes[0]], nodes[m.nodes[1]]) for m in mechanism.members if m.kind == "bar"}


def signed_distance(first: Segment, second: Segment) -> Component:
    """Distance of two segments [m]; where they cross, minus the shortest displacement that parts them.

    That is the least distance of an end of one of them from the line of the other: where they cross, the origin is in
    the parallelogram that is their Minkowski difference, whose sides are parallel to them.
    """
    (a, b), (c, d) = first, second
    sides = _side(a, b, c), _side(a, b, d), _side(c, d, a), _side(c, d, b)
    ends = [point_distance(a, second), point_distance(b, second), point_distance(c, first), point_distance(d, first)]
    xp = namespace_of(*ends)
    lengths = [xp.hypot(q[0] - p[0], q[1] - p[1]) for p, q in (first, second)]
    crossed = (sides[0] * sides[1] < 0) & (sides[2] * sides[3] < 0)
    depths = [abs(side) / length for side, length in zip(sides, (*lengths[:1] * 2, *lengths[1:] * 2), strict=True)]
    return xp.where(crossed, -reduce(xp.minimum, depths), reduce(xp.minimum, ends))


def clearance(
    mechanism: Any,
    q: Sequence[Component],
    obstacles: Sequence[Obstacle],
    inputs: Any = None,
    own: Sequence[tuple[str, str]] = (),
) -> Component:
    """The least signed clearance of any bar from any obstacle [m]; component code.

    Args:
        mechanism: planar, with `nodes` and `members`.
        q: configuration, components.
        obstacles: at least one, if there are no pairs of its own bars.
        inputs: where `nodes` needs them.
        own: names of pairs of bars that must not touch each other; see `own_bars.own_pairs`.

    Raises:
        TypeError: the obstacles are no sequence of obstacles, the pairs none of names, the mechanism is none in a
            plane, or its nodes need inputs.
        ValueError: there are no obstacles and no pairs, or a pair names a bar that there is not.
    """
    check_obstacles(obstacles)
    if not (isinstance(own, list | tuple) and all(isinstance(pair, list | tuple) and len(pair) == 2 for pair in own)):
        raise TypeError(f"own = {own!r}: must be pairs of names of bars; own_bars.own_pairs(mechanism) gives them")
    if not obstacles and not own:
        raise ValueError("obstacles: must be one or more")
    bars = bars_of(mechanism, q, inputs)
    gaps = [obstacle.clearance(bar) for obstacle in obstacles for bar in bars.values()]
    unknown = sorted({name for pair in own for name in pair} - set(bars))
    if unknown:
        raise ValueError(f"own: {', '.join(unknown)}: bars are {', '.join(bars)}")
    gaps += [signed_distance(bars[first], bars[second]) for first, second in own]
    return reduce(namespace_of(*gaps).minimum, gaps)
