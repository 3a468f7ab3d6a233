"""Configurations of an arm with the tip at a target in which some joints are at limits: where searches begin."""

from collections.abc import Sequence
from itertools import combinations, product
from typing import Any

import numpy as np

from tensegrity_envs.mechanics.dual_triangle.inverse import wrap

MOST_CORNERS = 1000  # of a target, before the two joints are solved for: of more, some that are drawn

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


def corners(arm: Any, values: Sequence[Sequence[float]], target: tuple[float, float], limit: float) -> np.ndarray:
    """Configurations (n, k) within the limits, all joints but two at one of their values each, in every way.

    Args:
        arm: of three segments or more.
        values: of each joint [rad].
        target: (x, y) [m].
        limit: of the joint angles [rad].
    """
    n, found = arm.segments, []
    pairs = list(combinations(range(n), 2))
    most = max(1, MOST_CORNERS // len(pairs))
    for pair in pairs:
        others = [k for k in range(n) if k not in pair]
        ways = np.array(list(product(*(values[k] for k in others))), float).T
        if ways.shape[1] > most:
            ways = ways[:, np.random.default_rng(0).permutation(ways.shape[1])[:most]]
        q = np.zeros((n, ways.shape[1]))
        q[others] = ways
        found.append(completed(arm, q, pair, target))
    return _inside(np.hstack(found), limit)


def equal_corners(arm: Any, centre: np.ndarray, target: tuple[float, float], limit: float) -> np.ndarray:
    """Configurations (n, k) within the limits of which all joints but one are as far from `centre` (n,) as each other.

    For each joint and all signs of the others, distances at which what lies beyond the joint reaches to the target.
    """
    n, found = arm.segments, []
    signs = np.array(list(product((-1.0, 1.0), repeat=n - 1))).T
    if signs.shape[1] > MOST_CORNERS // n:
        signs = signs[:, np.random.default_rng(0).permutation(signs.shape[1])[: MOST_CORNERS // n]]
    for joint in range(n):
        way = np.insert(signs, joint, 0.0, axis=0)

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
    return _inside(np.hstack(found), limit)


def faces(
    arm: Any,
    values: Sequence[Sequence[float]],
    target: tuple[float, float],
    limit: float,
    count: int,
    centre: np.ndarray | None = None,
) -> np.ndarray:
    """Configurations (n, k) within the limits, of which random joints are at one of their values each, others anywhere.

    Args:
        arm, values, target, limit: see `corners`.
        count: how many are drawn before two joints, each pair of them in turn, are solved for.
        centre: angles (n,) from which, in every other one of them, joints are as far as each other, instead.
    """
    n, rng, found = arm.segments, np.random.default_rng(2), []
    pairs = list(combinations(range(n), 2))
    count = -(-count // len(pairs))
    for pair in pairs:
        q = rng.uniform(-limit, limit, (n, count)) * rng.choice([0.3, 1.0], count)
        fixed = np.stack([rng.choice(np.array(given, float), count) for given in values])
        if centre is not None:
            equal = centre[:, None] + rng.choice([-1.0, 1.0], (n, count)) * rng.uniform(0, limit, count)
            fixed = np.where(np.arange(count) % 2, equal, fixed)
        q = np.where(rng.uniform(size=(n, count)) < rng.uniform(size=count), fixed, q)
        found.append(completed(arm, q, pair, target))
    return _inside(np.hstack(found), limit)


def _inside(q: np.ndarray, limit: float) -> np.ndarray:
    return q[:, (np.abs(q) <= limit).all(axis=0)]
