"""The clearance of a planar arm as the least of many functions that are smooth where it is clear; for programmes.

The distance of a segment from a disc is smooth where it is positive; that from a wall is the lesser height of the two
ends; that from a convex polygon the least distance of an end from the polygon or of a corner from the segment; that of
two segments which do not cross the least distance of an end of one from the other.
"""

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np

from tensegrity_envs.geometry.clearance import (
    Obstacle,
    Polygon,
    Segment,
    Wall,
    bars_of,
    point_distance,
    signed_distance,
)


def clearance_parts(
    mechanism: Any, q: np.ndarray, obstacles: Sequence[Obstacle], own: Sequence[tuple[str, str]] = ()
) -> np.ndarray:
    """Parts (p, k) of the clearances [m] of configurations (n, k), whose least is the clearance itself.

    Args:
        mechanism: planar, whose nodes depend on nothing but q.
        q: configurations.
        obstacles, own: see `clearance.clearance`.
    """
    bars = bars_of(mechanism, tuple(q))
    table = {name: [[np.broadcast_to(x, q.shape[1:]) for x in end] for end in bar] for name, bar in bars.items()}
    stacked = _stacked([table[name] for name in bars])
    parts = [part for obstacle in obstacles for part in _of_obstacle(obstacle, stacked)]
    if own:
        parts += _of_pair(*(_stacked([table[pair[i]] for pair in own]) for i in (0, 1)))
    return np.concatenate(parts)


def _stacked(bars: Sequence[Any]) -> Segment:
    """One segment of arrays (bars, k)."""
    (ax, ay), (bx, by) = np.moveaxis(np.array(bars), 0, 2)
    return (ax, ay), (bx, by)


def _of_obstacle(obstacle: Obstacle, bar: Segment) -> list[np.ndarray]:
    """The clearance itself, and of what is no disc its parts, too."""
    whole = np.asarray(obstacle.clearance(bar))
    if isinstance(obstacle, Wall):
        return [np.asarray(obstacle.clearance((end, end))) for end in bar]
    if not isinstance(obstacle, Polygon):
        return [whole]
    edges = list(zip(obstacle.corners, (*obstacle.corners[1:], obstacle.corners[0]), strict=True))
    ends = [reduce(np.minimum, [point_distance(end, edge) for edge in edges]) for end in bar]
    return [whole, *(_beyond(whole, part) for part in (*ends, *(point_distance(at, bar) for at in obstacle.corners)))]


def _of_pair(first: Segment, second: Segment) -> list[np.ndarray]:
    whole = np.asarray(signed_distance(first, second))
    ends = [point_distance(end, second) for end in first] + [point_distance(end, first) for end in second]
    return [whole, *(_beyond(whole, part) for part in ends)]


def _beyond(whole: np.ndarray, part: Any) -> np.ndarray:
    """A distance where the two are apart; where they overlap it says nothing."""
    return np.asarray(np.where(whole > 0, part, np.maximum(part, whole)))
