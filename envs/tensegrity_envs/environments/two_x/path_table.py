"""Lengths of the singularity-avoiding paths between configurations of the plain 2-X, from a table."""

from functools import cache

import numpy as np

from tensegrity_envs.compiler.jit import Compiled
from tensegrity_envs.compiler.lowering import Matrix, Table, Vector
from tensegrity_envs.mechanics.two_x import TwoX, TwoXDesign

_NODES = 40  # along each angle
_LOOKS = 5  # along each edge
_FULL_TURN = 4 * np.pi


class PathTable:
    """Lengths of the shortest paths on a grid of the torus; a step counts more, the closer to a singularity it is.

    Args:
        design: without offsets.
    """

    def __init__(self, design: TwoXDesign) -> None:
        from scipy.sparse import coo_array  # slow to import, and only needed here
        from scipy.sparse.csgraph import dijkstra

        arm, n = TwoX(design), _NODES
        self._step = _FULL_TURN / n
        axis = np.arange(n) * self._step
        first = np.arange(n * n)
        i, j = first // n, first % n
        rows, columns, costs = [], [], []
        for di, dj in ((1, 0), (0, 1), (1, 1), (1, -1)):
            heights = []
            for t in np.linspace(0, 1, _LOOKS):
                q = (axis[i] + t * di * self._step, axis[j] + t * dj * self._step)
                heights.append(4 * arm.jacobian_determinant(q) / design.l**2)
            height = np.array(heights)
            # The same sign all along, and not a sliver between two singularities
            clear = (np.abs(np.sign(height).sum(axis=0)) == _LOOKS) & (np.abs(height).min(axis=0) > 0.01)
            cost = np.hypot(di, dj) * (1 + 0.1 / np.abs(height).mean(axis=0))
            rows.append(first[clear])
            columns.append(((i + di) % n * n + (j + dj) % n)[clear])
            costs.append(cost[clear])
        parts = (np.concatenate(part) for part in (costs, rows, columns))
        cost, row, column = parts
        lengths = dijkstra(coo_array((cost, (row, column)), shape=(n * n, n * n)).tocsr(), directed=False)
        self.longest = float(lengths[np.isfinite(lengths)].max())
        self._lengths = np.minimum(lengths, 1.2 * self.longest).astype(np.float32)

    def shares(self, q: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """The length of the path from q to the goal, each of shape (2, n) [rad], as a share of the longest, at most 1.

        It is interpolated between the nodes around q; corners without a path are left out.
        """
        out = np.empty(q.shape[1])
        given = (np.ascontiguousarray(v, float) for v in (q, goal))
        _shares(self._lengths, np.array([self._step, self.longest]), *given, out)
        return out


@Compiled
def _shares(lengths: Table, scales: Vector, q: Matrix, goal: Matrix, out: Vector) -> None:
    step, longest = scales[0], scales[1]
    for k in range(out.shape[0]):
        target = int(np.rint(goal[0, k] / step)) % _NODES * _NODES + int(np.rint(goal[1, k] / step)) % _NODES
        x, y = q[0, k] / step, q[1, k] / step
        i, j = int(np.floor(x)), int(np.floor(y))
        total, weights = 0.0, 0.0
        for di in range(2):
            for dj in range(2):
                length = lengths[(i + di) % _NODES * _NODES + (j + dj) % _NODES, target]
                if length < 1.1 * longest:
                    weight = (1 - abs(x - i - di)) * (1 - abs(y - j - dj))
                    total += weight * length
                    weights += weight
        out[k] = min(total / weights / longest, 1.0) if weights > 1e-9 else 1.0


@cache
def path_table_of(design: TwoXDesign) -> PathTable:
    """The table of a design, made once."""
    return PathTable(design)
