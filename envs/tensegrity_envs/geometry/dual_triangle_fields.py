"""What a dual-triangle arm of three segments can do at a point, over all postures with the tip there.

The postures with the tip at one point are closed curves (`mechanics.dual_triangle.self_motion`). A measure of postures
is maximized along them: its maximum is a continuous function of the point, and where it is zero is the boundary.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

import numpy as np
import shapely
from contourpy import contour_generator
from scipy.ndimage import distance_transform_edt

from tensegrity_envs.mechanics.dual_triangle import DualTriangle
from tensegrity_envs.mechanics.dual_triangle.self_motion import self_motions

Measure = Callable[[tuple[np.ndarray, ...]], np.ndarray]
STEEP = 8.0  # with which a measure falls to zero at the limits of a posture
_SAMPLES, _FINER, _ROUNDS = 128, 9, 3


@dataclass(frozen=True)
class Field:
    """A measure's maximum at the nodes of a grid, symmetric about the x axis.

    Attributes:
        x: of the columns [b].
        y: of the rows [b].
        value: shape (rows, columns); positive where the tip can be.
        best: the posture at which it is [rad], shape (3, rows, columns); NaN out of reach.
    """

    x: np.ndarray
    y: np.ndarray
    value: np.ndarray
    best: np.ndarray


def room(arm: DualTriangle, load: tuple[float, float] | None = None) -> Measure:
    """How far postures are within all limits: smallest free length [b] and angle to a joint limit [rad], negative
    beyond them.
    """
    limit, nominal, b = (float(v) for v in (arm.design.joint_limit, arm.design.free_length1, arm.design.b1))

    def measure(q: tuple[np.ndarray, ...]) -> np.ndarray:
        held = tuple(np.clip(qi, -limit, limit) for qi in q)
        delta = np.abs(np.array(arm.control(held, load)))
        within = limit - np.abs(np.array(q))
        return np.asarray(np.nan_to_num(np.minimum((nominal - delta).min(axis=0) / b, within.min(axis=0)), nan=-1.0))

    return measure


def stiffness(arm: DualTriangle, load: tuple[float, float]) -> Measure:
    """Smallest stiffness [k b^2] of postures that the inputs hold under a load; falls to zero at their limits."""
    limit, inside = float(arm.design.joint_limit), room(arm, load)

    def measure(q: tuple[np.ndarray, ...]) -> np.ndarray:
        held = tuple(np.clip(qi, -limit, limit) for qi in q)
        margin = arm.stability_margin(held, arm.free_lengths(arm.control(held, load)), load)
        return np.asarray(np.nan_to_num(np.minimum(np.asarray(margin), STEEP * inside(q)), nan=-1.0))

    return measure


def maximum(arm: DualTriangle, measure: Measure, cells: int = 100, mirrored: bool = True) -> Field:
    """The largest value of a measure at each point of a grid that covers the workspace.

    Args:
        arm: of three segments.
        measure: of postures.
        cells: columns of the grid.
        mirrored: whether arm and measure are mirror images of themselves, so that a half is enough.
    """
    links, b = arm._plain_links(), float(arm.design.b1)
    reach = 2 * links.long + links.short
    x = np.linspace(links.pivot - 1.02 * reach, links.pivot + 1.02 * reach, cells)
    step = x[1] - x[0]
    y = np.arange(int(1.02 * reach / step) + 2) * step
    if not mirrored:
        y = np.concatenate([-y[:0:-1], y])
    px, py = (np.ravel(v) for v in np.meshgrid(x, y))
    value, best = np.full(px.shape, -np.inf), np.full((3, px.size), np.nan)
    for index, curve in self_motions(px, py, *links):
        loop, s, _, _ = curve.grid(_SAMPLES)
        owner, rows = np.arange(len(index))[:, None], np.arange(len(index))
        places = np.broadcast_to(s, (len(index), _SAMPLES))
        loops = np.broadcast_to(loop, places.shape)
        width = float(s[1] - s[0])
        for _ in range(_ROUNDS):
            q = curve.at(owner, loops, places)
            found = measure(q)
            k = found.argmax(axis=1)
            top = found[rows, k]
            better = top > value[index]
            value[index] = np.maximum(value[index], top)
            best[:, index[better]] = np.array(q)[:, rows, k][:, better]
            places = places[rows, k][:, None] + width * np.linspace(-1, 1, _FINER)
            loops = np.broadcast_to(loops[rows, k][:, None], places.shape)
            width *= 2 / (_FINER - 1)
    away = (reach - np.hypot(px - links.pivot, py)) / b  # beyond the reach there are no postures
    value = np.minimum(np.where(np.isfinite(value), value, np.inf), STEEP * away)

    def whole(half: np.ndarray, sign: float) -> np.ndarray:
        half = half.reshape(len(y), len(x))
        return np.concatenate([sign * half[:0:-1], half]) if mirrored else half

    places_y = np.concatenate([-y[:0:-1], y]) if mirrored else y
    return Field(x / b, places_y / b, whole(value, 1.0), np.array([whole(angle, -1.0) for angle in best]))


def beyond(values: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Values continued by their nearest ones inside, so that contours run up to the boundary, where they are cut."""
    if not inside.any():
        return values
    nearest: np.ndarray = distance_transform_edt(~inside, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)])


def region_of(field: Field, b: float) -> shapely.Geometry:
    """Where a field is positive, as a shapely geometry [m]."""
    rings = [b * np.asarray(ring) for ring in contour_generator(field.x, field.y, field.value).lines(0.0)]
    polygons = [shapely.make_valid(shapely.Polygon(ring)) for ring in rings if len(ring) > 3]
    return reduce(shapely.symmetric_difference, polygons, shapely.Polygon())
