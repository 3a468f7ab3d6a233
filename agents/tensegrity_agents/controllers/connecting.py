"""A sampling planner of joint paths, for any mechanism.

It grows two trees of random configurations, one from the start and one from all goals, until they meet (RRT-Connect,
[Kuffner2000]), and then leaves out what straight free paths can skip.
"""

from collections.abc import Callable

import numpy as np

SPACING = 0.02  # [rad] of the looks along an edge
_REACH = 0.4  # [rad] longest edge of a tree
DRAWS = 4000
_SHORT_CUTS = 200

IsFree = Callable[[np.ndarray], np.ndarray]  # configurations (joints, k) -> (k,)


def is_edge_free(is_free: IsFree, start: np.ndarray, end: np.ndarray, spacing: float = SPACING) -> bool:
    """Whether the straight path between two configurations (joints,) is free, at looks so far apart [rad]."""
    looks = max(2, int(np.ceil(np.abs(end - start).max() / spacing)) + 1)
    return bool(is_free(start[:, None] + np.linspace(0.0, 1.0, looks) * (end - start)[:, None]).all())


class _Tree:
    """Configurations, each with the number of the one before it."""

    def __init__(self, roots: np.ndarray, spacing: float) -> None:
        self.spacing = spacing
        self.nodes, self.before, self.count = np.array(roots, float), [-1] * len(roots), len(roots)

    def nearest(self, q: np.ndarray) -> int:
        return int(np.abs(self.nodes[: self.count] - q).max(axis=1).argmin())

    def add(self, q: np.ndarray, before: int) -> int:
        if self.count == len(self.nodes):
            self.nodes = np.concatenate([self.nodes, np.empty_like(self.nodes)])
        self.nodes[self.count] = q
        self.before.append(before)
        self.count += 1
        return self.count - 1

    def grow(self, is_free: IsFree, q: np.ndarray, is_greedy: bool) -> int | None:
        """The node at q if it could be reached by free edges: by one edge, or greedily by many; else None."""
        at = self.nearest(q)
        while True:
            here = self.nodes[at]
            change = q - here
            share = min(1.0, _REACH / max(float(np.abs(change).max()), 1e-12))
            new = q if share == 1.0 else here + share * change
            if not is_edge_free(is_free, here, new, self.spacing):
                return None
            at = self.add(new, at)
            if share == 1.0 or not is_greedy:
                return at

    def way(self, node: int) -> list[np.ndarray]:
        """From a root to the node."""
        path = []
        while node >= 0:
            path.append(self.nodes[node].copy())
            node = self.before[node]
        return path[::-1]


def connect(
    is_free: IsFree,
    start: np.ndarray,
    ends: np.ndarray,
    limit: float,
    seed: int = 0,
    spacing: float = SPACING,
    draws: int = DRAWS,
) -> list[np.ndarray]:
    """A free joint path from a configuration to one of several others.

    Args:
        is_free: which configurations are.
        start: (joints,) [rad].
        ends: (k, joints) [rad].
        limit: of the joint angles [rad].
        seed: of the draws.
        spacing: of the looks along an edge [rad].
        draws: of configurations, at most.

    Returns:
        The configurations to visit one after another, the last one of `ends`; empty where no path was found.
    """
    if not len(ends) or not is_free(start[:, None])[0]:
        return []
    rng = np.random.default_rng(seed)
    trees = [_Tree(start[None], spacing), _Tree(ends, spacing)]
    for k in range(draws):
        growing, other = trees[k % 2], trees[1 - k % 2]
        q = rng.uniform(-limit, limit, len(start))
        node = growing.grow(is_free, q, is_greedy=False)
        if node is None:
            continue
        met = other.grow(is_free, growing.nodes[node].copy(), is_greedy=True)
        if met is not None:
            ways = [growing.way(node), other.way(met)]
            first, second = ways if k % 2 == 0 else ways[::-1]
            return _short_cut(is_free, [*first, *second[::-1][1:]], rng, spacing)[1:]
    return []


def _short_cut(is_free: IsFree, path: list[np.ndarray], rng: np.random.Generator, spacing: float) -> list[np.ndarray]:
    """The path without what straight free paths between two of its points, drawn at random, can skip."""
    for _ in range(_SHORT_CUTS):
        if len(path) < 3:
            break
        i, j = np.sort(rng.choice(len(path), 2, replace=False))
        if j - i > 1 and is_edge_free(is_free, path[i], path[j], spacing):
            path = path[: i + 1] + path[j:]
    return path
