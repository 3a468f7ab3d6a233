"""Configurations with the tip at a target in which some joints are at limits or kinks: where searches begin.

All joints but two are given, and an arm says how the other two, at any places along it, bring the tip to the target.
"""

import math
from collections.abc import Callable, Sequence
from itertools import combinations, product

import numpy as np

MOST_CORNERS = 1000  # of a target, before the two joints are solved for: of more, some that are drawn

# Configurations (n, k) and a pair of joints -> those (n, any) with the tip at the target that differ in these two only.
Complete = Callable[[np.ndarray, tuple[int, int]], np.ndarray]


def held_angles(objective: str, start: np.ndarray, limit: float) -> list[tuple[float, ...]]:
    """The angles of each joint that optima have it at: its limits, and of the "sum" where it starts."""
    kinks = [(at,) if objective == "sum" and abs(at) < limit else () for at in start.tolist()]
    return [(-limit, limit, *at) for at in kinks]


def corners(complete: Complete, values: Sequence[Sequence[float]], limit: float) -> np.ndarray:
    """Configurations (n, k) within the limits, all joints but two at one of their values each, in every way.

    Args:
        complete: of an arm of three joints or more and a target.
        values: of each joint [rad].
        limit: of the joint angles [rad].
    """
    n, found = len(values), []
    pairs = list(combinations(range(n), 2))
    most = max(1, MOST_CORNERS // len(pairs))
    for pair in pairs:
        others = [k for k in range(n) if k not in pair]
        ways = choices([values[k] for k in others], most)
        q = np.zeros((n, ways.shape[1]))
        q[others] = ways
        found.append(complete(q, pair))
    return within(np.hstack(found), limit)


def faces(
    complete: Complete,
    values: Sequence[Sequence[float]],
    limit: float,
    count: int,
    centre: np.ndarray | None = None,
) -> np.ndarray:
    """Configurations (n, k) within the limits, of which random joints are at one of their values each, others anywhere.

    Args:
        complete, values, limit: see `corners`.
        count: how many are drawn before two joints, each pair of them in turn, are solved for.
        centre: angles (n,) from which, in every other one of them, joints are as far as each other, instead.
    """
    n, rng, found = len(values), np.random.default_rng(2), []
    pairs = list(combinations(range(n), 2))
    count = -(-count // len(pairs))
    for pair in pairs:
        q = rng.uniform(-limit, limit, (n, count)) * rng.choice([0.3, 1.0], count)
        fixed = np.stack([rng.choice(np.array(given, float), count) for given in values])
        if centre is not None:
            equal = centre[:, None] + rng.choice([-1.0, 1.0], (n, count)) * rng.uniform(0, limit, count)
            fixed = np.where(np.arange(count) % 2, equal, fixed)
        q = np.where(rng.uniform(size=(n, count)) < rng.uniform(size=count), fixed, q)
        found.append(complete(q, pair))
    return within(np.hstack(found), limit)


def choices(values: Sequence[Sequence[float]], most: int) -> np.ndarray:
    """Every choice (n, k) of one of the values of each of n joints; of more than `most` choices as many, drawn."""
    if math.prod(map(len, values)) <= most:
        return np.array(list(product(*values)), float).T
    rng = np.random.default_rng(0)
    return np.stack([rng.choice(np.array(given, float), most) for given in values])


def equal_signs(joints: int, joint: int) -> np.ndarray:
    """Directions (n, k) along which all joints but one turn equally far, for all signs or some that are drawn."""
    signs = choices([(-1.0, 1.0)] * (joints - 1), max(1, MOST_CORNERS // joints))
    return np.insert(signs, joint, 0.0, axis=0)


def within(q: np.ndarray, limit: float) -> np.ndarray:
    """Those of configurations (n, k) that are within the limits."""
    return q[:, (np.abs(q) <= limit).all(axis=0)]
