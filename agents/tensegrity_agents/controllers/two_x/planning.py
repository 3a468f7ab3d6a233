"""Joint paths inside the stable wrench-feasible joint space: straight where that is possible, around its gaps where
it is not.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from tensegrity_agents.controllers.two_x.measurements import solutions
from tensegrity_envs.mechanics import NX, TwoX

_SAMPLES = 41  # along a straight path
_GRID = 81  # nodes along each angle
_CLEARANCE = 0.01  # least margin along a path [-]
_WORTH = 4.0  # [rad] of a longer path is what enough margin is worth against none


def margin(model: TwoX | NX, q: np.ndarray) -> np.ndarray:
    """The smaller of stability and wrench margin at configurations (2, ...); negative beyond the joint limits."""
    _, stability, wrench = model.posture(tuple(q))
    inside = np.abs(q).max(axis=0) <= model.design.joint_limit
    return np.where(inside, np.minimum(stability, wrench), -1.0)


def straight_clearance(model: TwoX | NX, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Least margin along the straight joint paths from `start` to `end`, both (2, n); shape (n,)."""
    s = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
    least: np.ndarray = margin(model, start[:, None] + s * (end - start)[:, None]).min(axis=0)
    return least


def choose_solution(
    model: TwoX, start: np.ndarray, target: np.ndarray, enough: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Of all inverse solutions of each target, the one whose straight joint path stays feasible and is shortest.

    Args:
        model: one design, or one for each of n targets.
        start: configurations (n, 2) [rad].
        target: positions (n, 2) [m].
        enough: least margin along a path [-] up to which more of it is worth a longer path; 0 looks at the length
            alone.

    Returns:
        The configurations (n, 2), and whether their straight path is feasible (n,). Where none is, the one whose path
        keeps the largest margin; where the target is out of reach, the start.
    """
    table, missing = solutions(model, target)
    rank = np.full(missing.shape, -np.inf)
    feasible = np.zeros(missing.shape, bool)
    for k in range(missing.shape[1]):
        clearance = straight_clearance(model, start.T, table[:, :, k])
        length = np.abs(table[:, :, k] - start.T).max(axis=0)
        feasible[:, k] = (clearance > 0) & ~missing[:, k]
        worth = 100.0 - length
        if enough > 0:
            worth = worth + _WORTH * np.minimum(clearance / enough, 1.0)
        rank[:, k] = np.where(missing[:, k], -np.inf, np.where(clearance > 0, worth, np.minimum(clearance, 0.0)))
    rows = np.arange(len(start))
    best = rank.argmax(axis=1)
    reached = ~missing[rows, best]
    chosen = np.where(reached[:, None], table[:, rows, best].T, start)
    return chosen, feasible[rows, best]


def plan(model: TwoX, start: np.ndarray, target: np.ndarray) -> list[np.ndarray]:
    """Shortest joint path from a configuration (2,) to any inverse solution of a target (2,), inside the feasible set.

    Dijkstra's method on a grid of the joint space, then short cuts along straight feasible pieces.

    Args:
        model: one design.
        start: [rad].
        target: [m].

    Returns:
        Configurations to visit one after another, the last one a solution; empty where there is no path.
    """
    table, missing = solutions(model, target[None])
    ends = [table[:, 0, k] for k in range(table.shape[2]) if not missing[0, k] and margin(model, table[:, 0, k]) > 0]
    if not ends:
        return []
    limit = model.design.joint_limit
    axis = np.linspace(-limit, limit, _GRID)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"))
    free = margin(model, grid) > _CLEARANCE
    number = np.arange(_GRID * _GRID).reshape(_GRID, _GRID)
    edges = [
        (
            number[_part(di)][:, _part(dj)][both],
            number[_part(-di)][:, _part(-dj)][both],
            max(abs(di), abs(dj)) + 0.2 * (abs(di) + abs(dj)),
        )
        for di, dj in ((1, 0), (0, 1), (1, 1), (1, -1))
        for both in [free[_part(di)][:, _part(dj)] & free[_part(-di)][:, _part(-dj)]]
    ]
    rows = np.concatenate([a for a, _, _ in edges])
    columns = np.concatenate([b for _, b, _ in edges])
    weights = np.concatenate([np.full(len(a), w) for a, _, w in edges])
    graph = coo_array((weights, (rows, columns)), shape=(number.size, number.size)).tocsr()

    def entries(q: np.ndarray) -> np.ndarray:
        """Free nodes near q that a straight line joins to it."""
        close = np.argsort(np.abs(grid - q[:, None, None]).max(axis=0).ravel())[:60]
        close = close[free.ravel()[close]]
        nodes = grid.reshape(2, -1)[:, close]
        return (
            close[straight_clearance(model, np.repeat(q[:, None], len(close), 1), nodes) > 0] if len(close) else close
        )

    origins = entries(start)
    if not len(origins):
        return []
    distance, before, _ = dijkstra(graph, directed=False, indices=origins, return_predecessors=True, min_only=True)
    best: tuple[float, int, np.ndarray] | None = None
    for end in ends:
        for node in entries(end)[:1]:
            if np.isfinite(distance[node]) and (best is None or distance[node] < best[0]):
                best = (float(distance[node]), int(node), end)
    if best is None:
        return []
    path = [best[2]]
    node = best[1]
    while node >= 0:
        path.append(grid.reshape(2, -1)[:, node])
        node = int(before[node])
    path.append(start)
    return _short_cuts(model, path[::-1])


def _part(offset: int) -> slice:
    return slice(max(offset, 0), _GRID + min(offset, 0))


def _short_cuts(model: TwoX, path: list[np.ndarray]) -> list[np.ndarray]:
    """Leave out every point that a straight feasible line can skip."""
    points = np.array(path).T
    kept, here = [], 0
    while here < points.shape[1] - 1:
        ahead = np.arange(here + 1, points.shape[1])
        clear = straight_clearance(model, np.repeat(points[:, [here]], len(ahead), 1), points[:, ahead])
        good = ahead[clear > min(_CLEARANCE, clear[0])]
        here = int(good[-1]) if len(good) else here + 1
        kept.append(points[:, here])
    return kept
