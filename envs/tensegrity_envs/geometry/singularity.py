"""Singularities of planar mechanisms: curves, cusps and nodes, aspects, and changes of posture that avoid them.

A mechanism is anything with `tip`, `jacobian` and `singularity` on components (q1, q2). Its singular curves are where
det J = 0; their images bound the regions of the workspace with a constant number of inverse solutions. Such an image
turns back at a *cusp*, where three inverse solutions meet, and crosses itself at a *node*, where two pairs do. An
*aspect* is a connected set of configurations without a singularity; a mechanism is *cuspidal* if two inverse solutions
of one point lie in one aspect, so that it can change its posture without meeting a singularity [Furet2018, section 4].
"""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.geometry.regions import Map, Region

Scalar = Callable[[Components], Component]  # (q1, q2) -> value, elementwise
Box = tuple[tuple[float, float], tuple[float, float]]

_STENCIL = 2e-3  # [rad] five-point differences: their truncation and rounding errors are both about 1e-13
_NEWTON = 40


class Planar(Protocol):
    """What a mechanism needs here."""

    @property
    def reach(self) -> Component:
        """An upper bound of the tip's distance from the base [m]."""

    def tip(self, q: Sequence[Component]) -> tuple[Component, Component]:
        """Tip position [m]."""

    def jacobian(self, q: Sequence[Component]) -> tuple[tuple[Component, Component], tuple[Component, Component]]:
        """d tip / d q."""

    def jacobian_determinant(self, q: Sequence[Component]) -> Component:
        """det J."""


class Cusp(NamedTuple):
    """A point where the image of a singular curve turns back: three inverse solutions meet in one configuration."""

    tip: tuple[float, float]
    configuration: tuple[float, float]


class Node(NamedTuple):
    """A point where the image of a singular curve crosses itself: two pairs of inverse solutions meet."""

    tip: tuple[float, float]
    configurations: tuple[tuple[float, float], tuple[float, float]]


def gradient(f: Scalar, q: np.ndarray) -> np.ndarray:
    """Gradient of f at configurations of shape (..., 2) by five-point differences, error about 1e-12."""
    found = np.empty(q.shape)
    for k in (0, 1):
        step = _STENCIL * np.eye(2)[k]
        near = np.asarray(f(components(q + step))) - np.asarray(f(components(q - step)))
        far = np.asarray(f(components(q + 2 * step))) - np.asarray(f(components(q - 2 * step)))
        found[..., k] = (8 * near - far) / (12 * _STENCIL)
    return found


def components(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The two components of configurations of shape (..., 2)."""
    return q[..., 0], q[..., 1]


def zero_curves(
    f: Scalar, box: Box, image: Map | None = None, resolution: int = 256, tolerance: float = 1e-6
) -> list[np.ndarray]:
    """The curves f = 0 in a box as chains of points on them; a closed one ends with its first point.

    Args:
        f: with simple zeros (it changes sign across its curves, and they do not cross).
        box: its lower and its upper corner.
        image, resolution, tolerance: see `Region.trace`.
    """
    traced = Region(lambda q1, q2: (f((q1, q2)),), ("f",), *box).trace(resolution, tolerance, image)
    chains = []
    for ring in traced.rings:
        on_curve = ring.conditions == 0
        if on_curve.all():
            chains.append(np.concatenate([ring.points, ring.points[:1]]))
            continue
        start = int(np.flatnonzero(~on_curve)[0]) + 1  # begin behind a segment of the box's edge
        points, segments = np.roll(ring.points, -start, axis=0), np.roll(on_curve, -start)
        for used, group in itertools.groupby(range(len(segments)), key=lambda i: bool(segments[i])):
            if used:
                run = list(group)
                chains.append(points[[*run, (run[-1] + 1) % len(points)]])
    return chains


def cusps(mechanism: Planar, curves: Sequence[np.ndarray], f: Scalar | None = None) -> list[Cusp]:
    """The cusps of the images of singular curves, each to about 1e-11, sorted by tip.

    Args:
        mechanism: whose tip is the map.
        curves: from `zero_curves`.
        f: the function that is zero on them, by default det J; a factor of it where det J has several.
    """
    f = f or mechanism.jacobian_determinant
    starts, directions = [], []
    for curve in curves:
        step = np.diff(np.stack(mechanism.tip(components(curve)), axis=1), axis=0)
        if len(step) > 2 and (curve[0] == curve[-1]).all():
            step = np.concatenate([step, step[:1]])
        turn = np.flatnonzero((step[1:] * step[:-1]).sum(axis=1) < 0)
        for i in turn:
            starts.append(curve[(i + 1) % (len(curve) - 1)])
            directions.append(step[i] - step[i + 1])
    if not starts:
        return []
    q, direction = np.array(starts), np.array(directions)
    direction /= np.hypot(*direction.T)[:, None]

    def conditions(points: np.ndarray) -> np.ndarray:
        """f, and how fast the image moves along the curve; both zero at a cusp."""
        slope = gradient(f, points)
        (xa, xb), (ya, yb) = mechanism.jacobian(components(points))
        along_x, along_y = xb * slope[:, 0] - xa * slope[:, 1], yb * slope[:, 0] - ya * slope[:, 1]
        return np.stack([np.asarray(f(components(points))), direction[:, 0] * along_x + direction[:, 1] * along_y], 1)

    q, good = _newton(conditions, q, longest=0.05)
    found: list[Cusp] = []
    for point in q[good]:
        configuration = (float(point[0]), float(point[1]))
        x, y = mechanism.tip(configuration)
        if not any(math.hypot(x - c.tip[0], y - c.tip[1]) < 1e-7 * mechanism.reach for c in found):
            found.append(Cusp((float(x), float(y)), configuration))
    return sorted(found)


def nodes(mechanism: Planar, curves: Sequence[np.ndarray], f: Scalar | None = None) -> list[Node]:
    """Where the images of singular curves cross themselves or one another, each to about 1e-11, sorted by tip.

    Args:
        mechanism, curves, f: see `cusps`.
    """
    import shapely  # slow to import, and only needed here

    f = f or mechanism.jacobian_determinant
    if not curves:
        return []
    begin, end = (np.concatenate([curve[part] for curve in curves]) for part in (slice(None, -1), slice(1, None)))
    a, b = (np.stack(mechanism.tip(components(points)), axis=1) for points in (begin, end))
    segments = shapely.linestrings(np.stack([a, b], axis=1))
    first, second = shapely.STRtree(segments).query(segments, predicate="intersects")
    # Neighbours touch at their common point; a self-motion is mapped to a point, where everything meets.
    apart = np.hypot(*(begin[first] - begin[second]).T) > 1e-2
    first, second = first[apart & (first < second)], second[apart & (first < second)]
    if not len(first):
        return []

    def conditions(points: np.ndarray) -> np.ndarray:
        p, q = points[:, :2], points[:, 2:]
        (px, py), (qx, qy) = mechanism.tip(components(p)), mechanism.tip(components(q))
        return np.stack([px - qx, py - qy, np.asarray(f(components(p))), np.asarray(f(components(q)))], axis=1)

    q, good = _newton(conditions, np.concatenate([begin[first], begin[second]], axis=1), longest=0.05)
    found: list[Node] = []
    for point in q[good]:
        p1, p2 = (float(point[0]), float(point[1])), (float(point[2]), float(point[3]))
        x, y = mechanism.tip(p1)
        same = math.hypot(p1[0] - p2[0], p1[1] - p2[1]) < 1e-3
        if not same and not any(math.hypot(x - n.tip[0], y - n.tip[1]) < 1e-7 * mechanism.reach for n in found):
            found.append(Node((float(x), float(y)), (min(p1, p2), max(p1, p2))))
    return sorted(found)


def _newton(f: Callable[[np.ndarray], np.ndarray], q: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Newton's method for many starting points, shape (n, d); the points, and whether each converged nearby."""
    start, h = q.copy(), 1e-4
    length = np.full(len(q), np.inf)
    for _ in range(_NEWTON):
        value = f(q)
        slope = np.stack([(f(q + h * e) - f(q - h * e)) / (2 * h) for e in np.eye(q.shape[1])], axis=2)
        step = np.stack([np.linalg.lstsq(s, v, rcond=1e-12)[0] for s, v in zip(slope, value, strict=True)])
        length = np.linalg.norm(step, axis=1)
        q = q - step * np.minimum(1.0, longest / np.maximum(length, 1e-300))[:, None]
        if length.max() < 1e-13:
            break
    near = np.linalg.norm(q - start, axis=1) < 4 * longest
    # At a cusp the tip moves with the square of the distance from it, so that 1e-7 is more than enough.
    return q, near & (length < 1e-7) & (np.abs(f(q)).max(axis=1) < 1e-9)
