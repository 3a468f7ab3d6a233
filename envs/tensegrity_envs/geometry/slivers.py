"""What a traced boundary has missed: pieces and ends of pieces that are narrower than a cell of the grid.

Exact slices of the region along lines between the grid's are compared with the traced polygons.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tensegrity_envs.geometry.boundary import Map, Ring
from tensegrity_envs.geometry.conditions import Conditions

_SAMPLES = 257  # along each line
_AROUND = 3  # cells
_STEP = 1e-6  # of differences of the map, relative to the box


class Missed(NamedTuple):
    """Estimates of the area between a region and its polygons, in the plane and in its image."""

    area: float
    image: float


def missed(
    region: Conditions,
    rings: Sequence[Ring],
    cell: float,
    lines: int,
    image: Map | None,
) -> Missed:
    """The area that the polygons miss or have too much: the mean over lines in both directions.

    Lines all over the box find pieces that the grid has not seen, lines around each piece the ends of those it has.

    Args:
        region: that was traced.
        rings: its polygons.
        cell: width of the grid's cells.
        lines: in each direction.
        image: a map of the plane, by whose determinant areas in the image are larger; None for none.
    """
    everywhere = _on_lines(region, rings, lines, image)
    pieces = [
        _on_lines(replace(region, lower=tuple(low.tolist()), upper=tuple(high.tolist())), rings, lines, image)
        for low, high in _surroundings(region, rings, cell)
    ]
    around = np.sum(pieces, axis=0) if pieces else np.zeros(2)
    area, mapped = np.maximum(everywhere, around)
    return Missed(float(area), float(mapped))


def _surroundings(region: Conditions, rings: Sequence[Ring], cell: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Boxes around the pieces, some cells wider than they are; those that overlap are one."""
    boxes: list[tuple[np.ndarray, np.ndarray]] = []
    for ring in rings:
        low = np.maximum(ring.points.min(axis=0) - _AROUND * cell, region.lower)
        high = np.minimum(ring.points.max(axis=0) + _AROUND * cell, region.upper)
        apart = []
        for other in boxes:
            if (other[0] <= high).all() and (low <= other[1]).all():
                low, high = np.minimum(low, other[0]), np.maximum(high, other[1])
            else:
                apart.append(other)
        boxes = [*apart, (low, high)]
    return boxes


def _on_lines(region: Conditions, rings: Sequence[Ring], lines: int, image: Map | None) -> np.ndarray:
    """Area between region and polygons within the region's box, in the plane and in the image."""
    lower, upper = np.array(region.lower), np.array(region.upper)
    totals = np.zeros((2, 2))
    for fixed in (0, 1):
        width = upper[fixed] - lower[fixed]
        values = lower[fixed] + width * (np.arange(lines) + 0.381966) / lines
        for value, intervals in zip(values, region.slices(fixed, values, _SAMPLES), strict=True):
            ends = [end for interval in intervals for end in interval[:2]]
            polygons = np.clip(_crossings(rings, fixed, float(value)), lower[1 - fixed], upper[1 - fixed])
            for low, high in _difference(np.array(ends), polygons):
                length, middle = high - low, (low + high) / 2
                q = np.array([value, middle] if fixed == 0 else [middle, value])
                grown = _growth(image, q, _STEP * (upper - lower)) if image is not None else 0.0
                totals[fixed] += width / lines * length * np.array([1.0, grown])
    return np.asarray(totals.max(axis=0))  # a sliver along the lines of one direction is not seen by them


def _crossings(rings: Sequence[Ring], fixed: int, value: float) -> np.ndarray:
    """Where a line leaves and enters polygons, sorted."""
    found = []
    for ring in rings:
        here = ring.points
        after = np.roll(here, -1, axis=0)
        crosses = (here[:, fixed] > value) != (after[:, fixed] > value)
        a, b = here[crosses], after[crosses]
        share = (value - a[:, fixed]) / (b[:, fixed] - a[:, fixed])
        found.append(a[:, 1 - fixed] + share * (b[:, 1 - fixed] - a[:, 1 - fixed]))
    return np.sort(np.concatenate([*found, np.empty(0)]))


def _difference(first: np.ndarray, second: np.ndarray) -> list[tuple[float, float]]:
    """Intervals that belong to one of two sets of intervals, given by their sorted ends, and not to the other."""
    ends = np.sort(np.concatenate([first, second]))
    return [(float(a), float(b)) for a, b in zip(ends[::2], ends[1::2], strict=False) if b > a]


def _growth(image: Map, q: np.ndarray, step: np.ndarray) -> float:
    """|det| of the map's Jacobian at q, by central differences."""
    first, second = np.diag(step)
    points = np.stack([q + first, q - first, q + second, q - second], axis=1)
    x, y = (np.asarray(part, float) for part in image((points[0], points[1])))
    return float(abs((x[0] - x[1]) * (y[2] - y[3]) - (x[2] - x[3]) * (y[0] - y[1])) / (4 * step[0] * step[1]))
