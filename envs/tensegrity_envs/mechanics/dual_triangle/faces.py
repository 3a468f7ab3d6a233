"""Two joints of an arm in closed form, and joints that are equally far from a centre: places where searches begin."""

from typing import Any

import numpy as np

from tensegrity_envs.mechanics.dual_triangle.inverse import wrap
from tensegrity_envs.mechanics.optima.faces import equal_signs, within

_DISTANCES, _HALVINGS = 100, 40  # of the search for equal distances


def completed(arm: Any, q: np.ndarray, pair: tuple[int, int], target: tuple[float, float]) -> np.ndarray:
    """The configurations (n, any) with the tip at the target that differ from these (n, k) in a pair of joints only.

    What lies between the two joints, and what lies beyond the second one, are rigid: a two-link arm.
    """
    i, j = pair
    to_target = _seen_from(arm, q, i, target)
    near, far, between = _chain(arm, q, i, j), _chain(arm, q, j, arm.segments), q[i + 1 : j].sum(axis=0)
    sides = 2 * np.abs(near) * np.abs(far)
    cosine = (np.abs(to_target) ** 2 - np.abs(near) ** 2 - np.abs(far) ** 2) / np.where(sides > 0, sides, 1.0)
    there = np.flatnonzero((np.abs(cosine) <= 1) & (sides > 0))
    found = []
    for sign in (1.0, -1.0):
        last = np.angle(near) - np.angle(far) - between + sign * np.arccos(np.clip(cosine, -1.0, 1.0))
        one = q.copy()
        one[i] = wrap(np.angle(to_target) - np.angle(near + np.exp(1j * (between + last)) * far))
        one[j] = wrap(last)
        found.append(one[:, there])
    return np.hstack(found)


def _chain(arm: Any, q: np.ndarray, first: int, last: int) -> np.ndarray:
    """From pivot `first` to pivot `last`, with joint `first` straight, as complex numbers along the link before."""
    turn = np.cumsum(q[first + 1 : last], axis=0)
    links = np.array(arm.link_lengths[first + 1 : last], float)[:, None] * np.exp(1j * turn)
    return np.asarray(arm.link_lengths[first] + links.sum(axis=0))


def _seen_from(arm: Any, q: np.ndarray, joint: int, target: tuple[float, float]) -> np.ndarray:
    """From the joint's pivot to the target, along the link before."""
    base = float(arm.base_height) + (np.exp(1j * q[0]) * _chain(arm, q, 0, joint) if joint else 0.0)
    return np.asarray((complex(*target) - base) * np.exp(-1j * q[:joint].sum(axis=0)))


def equal_corners(arm: Any, centre: np.ndarray, target: tuple[float, float], limit: float) -> np.ndarray:
    """Configurations (n, k) within the limits of which all joints but one are as far from `centre` (n,) as each other.

    For each joint and all signs of the others, distances at which what lies beyond the joint reaches to the target.
    """
    n, found = arm.segments, []
    for joint in range(n):
        way = equal_signs(n, joint)

        def gap(far: np.ndarray, way: np.ndarray, joint: int = joint) -> np.ndarray:
            q = centre[:, None] + way * far
            return np.asarray(np.abs(_seen_from(arm, q, joint, target)) - np.abs(_chain(arm, q, joint, n)))

        grid = np.linspace(0, limit + np.abs(centre).max(), _DISTANCES)
        values = np.stack([gap(np.full(way.shape[1], far), way) for far in grid])
        at, column = np.nonzero(values[1:] * values[:-1] < 0)
        low, high, way, rising = grid[at], grid[at + 1], way[:, column], values[at, column] < 0
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            is_before = (gap(middle, way) < 0) == rising
            low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
        q = centre[:, None] + way * low
        q[joint] = wrap(np.angle(_seen_from(arm, q, joint, target)) - np.angle(_chain(arm, q, joint, n)))
        found.append(q)
    return within(np.hstack(found), limit)
