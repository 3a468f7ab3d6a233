"""Joint paths under a known tip load: postures that the inputs can hold stably, and paths from one to another.

A posture is valid if the control law holds it within the bounds of the inputs, inside the joint limits, with a positive
definite stiffness matrix. Inside the valid set the control inputs are smooth coordinates of the posture, so the arm
follows any path in it, however the load pushes.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from tensegrity_agents.controllers.dual_triangle.identification import links
from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.mechanics.dual_triangle import DualTriangle, DualTriangleDesign
from tensegrity_envs.mechanics.dual_triangle.self_motion import self_motions

POSTURES = 96  # of the self-motion curve or curves of one target
_SAMPLES = 33  # along a straight joint path
_ENOUGH = 0.1  # clearance beyond which a path is chosen for being short
_CLEARANCE = 0.004  # least clearance of an edge of the road map
_NODES = 1500
_NEIGHBOURS = 16
_ENDS = 24  # postures of the target that the road map is joined to


def _validity(
    design: DualTriangleDesign, segments: int, q: Components, load: Components, bound: Component
) -> tuple[Component, Components]:
    arm = DualTriangle(design, segments)
    xp = namespace_of(*q)
    inputs = arm.control(q, load)
    clearance = arm.stability_margin(q, arm.free_lengths(inputs), load)
    clearance = xp.minimum(clearance, arm.limit_margin(q))
    for value in inputs:
        clearance = xp.minimum(clearance, (bound - abs(value)) / bound)
    return clearance, inputs


def validity(arm: DualTriangle, bound: float, q: np.ndarray, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far postures are from leaving the valid set, and the inputs that hold them.

    Args:
        arm: nominal.
        bound: largest control input [m].
        q: shape (..., 3) [rad].
        load: shape (..., 2), broadcasts against q [N].

    Returns:
        The least of stability margin [-], distance to the joint limit [rad] and distance of the inputs to their bound
        (as a share of it), shape (...); positive where valid. Control inputs, shape (..., 3) [m].
    """
    shape = q.shape[:-1]
    if not q.size:
        return np.zeros(shape), np.zeros(q.shape)
    columns = tuple(np.ascontiguousarray(q[..., i]).ravel() for i in range(3))
    force = tuple(np.broadcast_to(load[..., i], shape).ravel() for i in range(2))
    clearance, inputs = evaluate(_validity, arm.design, arm.segments, columns, force, bound)
    clearance = np.where(np.isfinite(clearance), clearance, -1.0)
    return clearance.reshape(shape), np.stack(inputs, axis=-1).reshape(q.shape)


def postures(arm: DualTriangle, target: np.ndarray, count: int = POSTURES) -> np.ndarray:
    """Postures (n, count, 3) [rad] with the tip at targets (n, 2) [m], all along the self-motion curves; else NaN."""
    found = np.full((len(target), count, 3), np.nan)
    for index, curve in self_motions(target[:, 0], target[:, 1], *links(arm)):
        loop, s, _, _ = curve.grid(count)
        owner = np.repeat(np.arange(len(index)), count)
        q = curve.at(owner, np.tile(loop, len(index)), np.tile(s, len(index)))
        found[index] = np.stack(q, axis=-1).reshape(len(index), count, 3)
    return found


def straight_clearance(
    arm: DualTriangle, bound: float, start: np.ndarray, end: np.ndarray, load: np.ndarray, samples: int = _SAMPLES
) -> np.ndarray:
    """Least clearance along straight joint paths from `start` to `end`, both (m, 3), under loads (m, 2); shape (m,)."""
    s = np.linspace(0.0, 1.0, samples)[None, :, None]
    path = start[:, None] + s * (end - start)[:, None]
    least: np.ndarray = validity(arm, bound, path, load[:, None])[0].min(axis=1)
    return least


def choose_posture(
    arm: DualTriangle, bound: float, start: np.ndarray, target: np.ndarray, load: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of all postures of each target, the one to which the straight joint path keeps valid and is shortest.

    Args:
        arm: nominal.
        bound: largest control input [m].
        start: shape (n, 3) [rad].
        target: shape (n, 2) [m].
        load: shape (n, 2) [N].

    Returns:
        Postures (n, 3), and the clearance of their straight path (n,); where none is valid, the posture whose path
        comes nearest to it, and where there is no posture, the start.
    """
    table = postures(arm, target)
    here, _ = validity(arm, bound, table, load[:, None])
    row, column = np.nonzero(here > 0)
    clearance = np.full(here.shape, -np.inf)
    clearance[row, column] = straight_clearance(arm, bound, start[row], table[row, column], load[row])
    length = np.abs(table - start[:, None]).max(axis=2)
    valid = clearance > 0
    # beyond a clearance of `_ENOUGH` only the length counts; the rank of what is not valid stays below
    rank = np.where(valid, 1e3 + 100 * np.minimum(clearance, _ENOUGH) - length, clearance)
    rank = np.where(np.isfinite(rank), rank, np.where(np.isfinite(here), -1e6 + here, -np.inf))
    rows, best = np.arange(len(start)), rank.argmax(axis=1)
    reached = np.isfinite(rank[rows, best])
    chosen = np.where(reached[:, None], table[rows, best], start)
    return chosen, np.where(reached, clearance[rows, best], -np.inf)


class RoadMap:
    """Random postures that are valid under one load, joined by straight paths that stay valid."""

    def __init__(self, arm: DualTriangle, bound: float, load: np.ndarray, rng: np.random.Generator) -> None:
        self.arm, self.bound, self.load = arm, bound, load
        limit = float(arm.design.joint_limit)
        q = rng.uniform(-limit, limit, (3 * _NODES, 3))
        self.nodes = q[validity(arm, bound, q, load)[0] > _CLEARANCE][:_NODES]

    def path(self, start: np.ndarray, target: np.ndarray, rate: float) -> list[np.ndarray]:
        """The path with the fewest steps from a posture (3,) to any posture of a target (2,) [m].

        Returns:
            Postures to visit one after another, the last one with the tip at the target; empty where there is no path.
        """
        arm, bound, load = self.arm, self.bound, self.load
        ends = postures(arm, target[None], 2 * POSTURES)[0]
        clearance, _ = validity(arm, bound, ends, load)
        ends = ends[np.flatnonzero(clearance > 0)]
        if not len(ends):
            return []
        ends = ends[:: max(1, len(ends) // _ENDS)]
        points = np.concatenate([start[None], ends, self.nodes])
        margin, inputs = validity(arm, bound, points, load)
        first = 1 + len(ends)
        near = np.asarray(cKDTree(points).query(points, k=min(_NEIGHBOURS, len(points)))[1])
        pairs = {(min(i, j), max(i, j)) for i, row in enumerate(near.tolist()) for j in row if i != j}
        pairs |= {(0, j) for j in range(1, len(points)) if j < first}
        edges = np.array(sorted(pairs))
        ok = straight_clearance(
            arm, bound, points[edges[:, 0]], points[edges[:, 1]], np.broadcast_to(load, (len(edges), 2))
        )
        edges = edges[ok > np.minimum(_CLEARANCE, margin[edges].min(axis=1) / 2)]
        if not len(edges):
            return []
        a, b = points[edges[:, 0]], points[edges[:, 1]]
        weight = np.abs(inputs[edges[:, 0]] - inputs[edges[:, 1]]).max(axis=1) / rate
        weight = np.maximum(weight, np.abs(a - b).max(axis=1) / 0.2) + 0.1
        graph = coo_array((weight, (edges[:, 0], edges[:, 1])), shape=(len(points), len(points))).tocsr()
        distance, before = dijkstra(graph, directed=False, indices=[0], return_predecessors=True)
        best = 1 + int(np.argmin(distance[0, 1:first]))
        if not np.isfinite(distance[0, best]):
            return []
        path = []
        while best != 0:
            path.append(points[best])
            best = int(before[0, best])
        return self._short_cuts([start, *path[::-1]])

    def _short_cuts(self, path: list[np.ndarray]) -> list[np.ndarray]:
        """Leave out every point that a straight valid line can skip."""
        points = np.array(path)
        kept, here = [], 0
        while here < len(points) - 1:
            ahead = np.arange(here + 1, len(points))
            load = np.broadcast_to(self.load, (len(ahead), 2))
            clear = straight_clearance(
                self.arm, self.bound, np.repeat(points[[here]], len(ahead), 0), points[ahead], load, 2 * _SAMPLES
            )
            good = ahead[clear > np.clip(clear[0], 0.0, _CLEARANCE)]
            here = int(good[-1]) if len(good) else here + 1
            kept.append(points[here])
        return kept


def course(
    arm: DualTriangle, path: np.ndarray, load: np.ndarray, rate: float, steps: int, largest_turn: float = 0.2
) -> np.ndarray:
    """Postures, step by step, along a joint path at full rate.

    Args:
        arm: nominal.
        path: waypoints (k, segments) [rad], the first one where the arm is.
        load: shape (2,) [N].
        rate: largest change of an input in one step [m].
        steps: as many as there are.
        largest_turn: of a joint in one step [rad]; given up where there are not enough steps.

    Returns:
        Shape (steps, segments) [rad]; after the end of the path, its last posture.
    """
    return _courses(arm, [path], load[None], rate, steps, largest_turn)[0]


def _courses(
    arm: DualTriangle, paths: Sequence[np.ndarray], loads: np.ndarray, rate: float, steps: int, largest_turn: float
) -> list[np.ndarray]:
    """`course` of each of these paths under loads (n, 2) [N]; the control law is evaluated for all of them at once."""
    fine = [_fine(path) for path in paths]
    counts = [len(q) for q in fine]
    inputs = _controls(arm, np.concatenate(fine), np.repeat(loads, counts, axis=0))
    found = []
    for q, u in zip(fine, np.split(inputs, np.cumsum(counts)[:-1]), strict=True):
        change = np.abs(np.diff(u, axis=0)).max(axis=1) / rate
        turn = np.abs(np.diff(q, axis=0)).max(axis=1)
        cost = np.maximum(change, turn / largest_turn)
        if cost.sum() > steps - 2:
            cost = np.maximum(change, turn / 1.0)
        done = np.concatenate([[0.0], np.cumsum(cost)])
        places: Any = np.minimum(np.arange(1, steps + 1), done[-1])
        found.append(np.stack([np.interp(places, done, angle) for angle in q.T], axis=1))
    return found


def _fine(path: np.ndarray) -> np.ndarray:
    """A joint path in small pieces, shape (points, segments) [rad]."""
    pieces = [np.linspace(0.0, 1.0, 201)[1:, None] * (b - a) + a for a, b in pairwise(path)]
    return np.concatenate([path[:1], *pieces])


def _controls(arm: DualTriangle, q: np.ndarray, load: np.ndarray) -> np.ndarray:
    """The control law in postures (n, segments) [rad] under loads (n, 2) [N], shape (n, segments) [m]."""
    return np.stack(arm.control(tuple(q.T), tuple(load.T)), axis=1)


def schedules(arm: DualTriangle, paths: Sequence[np.ndarray], loads: np.ndarray, rate: float, steps: int) -> np.ndarray:
    """Control inputs, step by step, that lead arms along joint paths at full rate.

    Args:
        arm: nominal.
        paths: n of them, see `course`, likewise the others.
        loads: shape (n, 2) [N].
        rate: largest change of an input in one step [m].
        steps: as many as there are.

    Returns:
        Shape (n, steps, segments) [m]; at the end of each path, its last inputs.
    """
    if not len(paths):
        return np.zeros((0, steps, arm.segments))
    along = np.concatenate(_courses(arm, paths, loads, rate, steps, 0.2))
    return _controls(arm, along, np.repeat(loads, steps, axis=0)).reshape(len(paths), steps, -1)
