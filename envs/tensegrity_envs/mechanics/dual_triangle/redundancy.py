"""Which of the configurations with the tip at a target: the optimum of an objective, exact and within joint limits.

[Zhao2021, section III] minimizes (a) the sum, (b) the largest and (c) the sum of squares of the joints' displacements
from a start (the print lost the minus sign of (a) and (c)). Along the self-motion curve the minima of (a) and (b) are
mostly kinks, and joint limits cut the curve into arcs. So every minimum is one of: an end of an arc or a kink of (a),
where one angle is known and the other two follow in closed form; or a local minimum of the curve without limits, which
a golden section search finds from samples of the smooth parametrization (`self_motion`).
"""

import math
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np

from tensegrity_envs.mechanics.dual_triangle.self_motion import SelfMotion, self_motions, with_one_angle
from tensegrity_envs.mechanics.namespace import Component, Components

Objective = Literal["sum", "max", "squares"]
_OBJECTIVES = ("sum", "max", "squares")
_SAMPLES = 96  # of the curve or curves of one target
_BLOCK = 256  # targets at a time: their samples stay in the cache
_ON_LIMIT = 1e-9  # [rad]: as far beyond its limit as rounding may leave an angle
_GOLDEN = (math.sqrt(5) - 1) / 2


class Redundancy(NamedTuple):
    """Answer to "which configuration has its tip at the target?", or where there is none, the nearest.

    Attributes:
        configuration: (q1, q2, q3) [rad]; for an unreachable target, of the nearest reachable point.
        objective: its value [rad, or rad^2 for "squares"].
        is_reachable: whether the target is reached within the joint limits.
        nearest: the target, or the reachable point nearest to it, (x, y) [m].
        distance: of `nearest` from the target [m]; 0 where that is reachable.
    """

    configuration: Components
    objective: Component
    is_reachable: Component
    nearest: tuple[Component, Component]
    distance: Component


class Links(NamedTuple):
    """What the kinematics of three segments depends on [m]: x of pivot 1, links 1 and 2, link 3."""

    pivot: float
    long: float
    short: float

    def tip(self, q: Any) -> tuple[np.ndarray, np.ndarray]:
        """Tip of configurations [m]."""
        t1, t2, t3 = q[0], q[0] + q[1], q[0] + q[1] + q[2]
        return (
            self.pivot + self.long * (np.cos(t1) + np.cos(t2)) + self.short * np.cos(t3),
            self.long * (np.sin(t1) + np.sin(t2)) + self.short * np.sin(t3),
        )


def objective_of(name: str, wraps: bool) -> Callable[[Any, Any], np.ndarray]:
    """The objective as a function of configuration and start; where there are no limits, displacements are wrapped.

    Raises:
        ValueError: there is no such objective.
    """
    if name not in _OBJECTIVES:
        raise ValueError(f"objective = {name!r}: must be one of {', '.join(_OBJECTIVES)}")

    def displacement(q: Any, start: Any) -> Any:
        move = q - start
        if wraps:
            move = np.pi - np.abs(np.pi - np.abs(move) % (2 * np.pi))
        return np.abs(move)

    def value(q: Any, start: Any) -> np.ndarray:
        m1, m2, m3 = (displacement(qi, si) for qi, si in zip(q, start, strict=True))
        if name == "sum":
            return np.asarray(m1 + m2 + m3)
        if name == "max":
            return np.asarray(np.maximum(np.maximum(m1, m2), m3))
        return np.asarray(m1 * m1 + m2 * m2 + m3 * m3)

    return value


def resolve(links: Links, x: np.ndarray, y: np.ndarray, start: Any, objective: str, limit: np.ndarray) -> Redundancy:
    """`DualTriangle.redundancy` on arrays: targets of shape (n,), start three of them, limit [rad] of shape (n,)."""
    n = len(x)
    q = np.empty((3, n))
    value, reached = np.empty(n), np.empty(n, bool)
    nearest = np.empty((2, n))
    for first in range(0, n, _BLOCK):
        part = slice(first, first + _BLOCK)
        q[:, part], value[part], reached[part] = _resolve_block(
            links, x[part], y[part], start[:, part], objective, limit[part]
        )
    nearest[0], nearest[1] = x, y
    missed = np.flatnonzero(~reached)
    if len(missed):
        q[:, missed] = nearest_configurations(links, x[missed], y[missed], limit[missed])
        nearest[:, missed] = links.tip(q[:, missed])
        wraps = bool(np.isinf(limit[missed]).all())
        value[missed] = objective_of(objective, wraps)(q[:, missed], start[:, missed])
    distance = np.hypot(nearest[0] - x, nearest[1] - y)
    return Redundancy((q[0], q[1], q[2]), value, reached, (nearest[0], nearest[1]), distance)


def _resolve_block(
    links: Links, x: np.ndarray, y: np.ndarray, start: np.ndarray, objective: str, limit: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    limited = bool(np.isfinite(limit).any())
    measure = objective_of(objective, not limited)
    best = np.full(len(x), np.inf)
    q = np.zeros((3, len(x)))

    def offer(owner: np.ndarray, candidates: Any, allowed: np.ndarray) -> None:
        """Candidates of shape (targets in owner, any number)."""
        values = np.where(allowed, measure(candidates, start[:, owner, None]), np.inf)
        column = values.argmin(axis=1)
        row = np.arange(len(owner))
        better = values[row, column] < best[owner]
        chosen = owner[better]
        best[chosen] = values[row, column][better]
        for component, candidate in zip(q, candidates, strict=True):
            component[chosen] = candidate[row, column][better]

    everyone = np.arange(len(x))
    roomy = limit[:, None] + _ON_LIMIT
    for joint in range(3):
        values = []
        if limited:
            values += [-limit[:, None], limit[:, None]]
        if objective == "sum":
            values.append(start[joint][:, None])
        if values:
            given = np.concatenate(values, axis=1)
            given = np.where(np.isfinite(given), given, 0.0)
            for found, exists in with_one_angle(x[:, None], y[:, None], *links, joint, given):
                offer(everyone, found, exists & _within(found, roomy))
    for index, curve in self_motions(x, y, *links):
        _search_curves(index, curve, measure, start, roomy, best, offer, 46 if objective == "max" else 34)
    return q, best, np.isfinite(best)


def _within(q: Any, limit: np.ndarray) -> np.ndarray:
    return np.asarray((np.abs(q[0]) <= limit) & (np.abs(q[1]) <= limit) & (np.abs(q[2]) <= limit))


def _search_curves(
    index: np.ndarray,
    curve: SelfMotion,
    measure: Callable[[Any, Any], np.ndarray],
    start: np.ndarray,
    limit: np.ndarray,
    best: np.ndarray,
    offer: Callable[[np.ndarray, Any, np.ndarray], None],
    iterations: int,
) -> None:
    loop, s, before, after = curve.grid(_SAMPLES)
    q = curve.at(np.arange(len(index))[:, None], loop, s)
    origin = start[:, index, None]
    values = measure(q, origin)
    bound = limit[index]
    offer(index, q, _within(q, bound))
    # Local minima among the samples; those that cannot come near the best feasible value, or near a feasible
    # configuration, are left out: the objective changes by no more than its measure of the step.
    row, column = np.nonzero((values <= values[:, before]) & (values < values[:, after]))
    beside = before[column], after[column]
    here = np.stack([component[row, column] for component in q])
    excess = np.zeros(len(row))
    for component in q:
        excess = np.maximum(excess, np.abs(component[row, column]) - bound[row, 0])
    drop, room = np.zeros(len(row)), np.zeros(len(row))
    for neighbour in beside:
        there = np.stack([component[row, neighbour] for component in q])
        step = np.abs(there - here)
        step = np.minimum(step, 2 * math.pi - step)
        room = np.maximum(room, step.max(axis=0))
        drop = np.maximum(drop, values[row, neighbour] - values[row, column] + step.sum(axis=0))
    promising = (excess <= 2 * room) & (values[row, column] - 2 * drop <= best[index[row]])
    row, column = row[promising], column[promising]
    if not len(row):
        return
    loop_there, middle = loop[column], s[column]
    width = 2 * math.pi / (_SAMPLES if curve.kind == "single" else _SAMPLES // 2)
    low, high = middle - width, middle + width
    starts = start[:, index[row]]

    def at(place: np.ndarray) -> np.ndarray:
        return measure(curve.at(row, loop_there, place), starts)

    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = at(left), at(right)
    for _ in range(iterations):
        go_left = at_left <= at_right
        low, high = np.where(go_left, low, left), np.where(go_left, right, high)
        inner = np.where(go_left, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        value = at(inner)
        left, right = np.where(go_left, inner, right), np.where(go_left, left, inner)
        at_left, at_right = np.where(go_left, value, at_right), np.where(go_left, at_left, value)
    place = np.where(at_left <= at_right, left, right)
    found = curve.at(row, loop_there, place)
    allowed = _within(found, bound[row, 0])
    # one target may own several minima: the best last
    order = np.argsort(-np.where(allowed, measure(found, starts), np.inf), kind="stable")
    order = order[allowed[order]]
    found = tuple(component[order][:, None] for component in found)
    owner = index[row[order]]
    for_each = {int(o): i for i, o in enumerate(owner)}
    keep = np.fromiter(for_each.values(), int, len(for_each))
    offer(owner[keep], tuple(component[keep] for component in found), np.ones((len(keep), 1), bool))


def nearest_configurations(links: Links, x: np.ndarray, y: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Configurations within the limits whose tips are nearest to unreachable targets, shape (3, n).

    At the nearest point every angle is at a limit, or the line from its pivot to the tip passes through the target: all
    combinations are tried, each of which is a closed form.
    """
    u, v, bound = x - links.pivot, y, limit
    n = len(u)
    target = u + 1j * v
    candidates: list[tuple[Any, Any, Any]] = []
    ends = [np.zeros(n)] if not np.isfinite(bound).any() else [-bound, bound]
    l1, l3 = links.long, links.short

    def direction(value: Any) -> Any:
        return np.angle(value)

    # all three free: stretched or folded (which only a limit of pi allows)
    for fold2 in (0.0, math.pi):
        for fold3 in (0.0, math.pi):
            sign = np.sign((l1 + np.cos(fold2) * (l1 + np.cos(fold3) * l3)).real) or 1.0
            for flip in (0.0, math.pi):
                candidates.append((direction(sign * target) + flip, fold2 + 0 * u, fold3 + 0 * u))
    for q3 in ends:
        tail = l1 + l3 * np.exp(1j * q3)
        # joint 3 at its limit; joints 1 and 2 free
        for fold in (0.0, math.pi):
            for flip in (0.0, math.pi):
                candidates.append((direction(target) + flip, fold - direction(tail), q3))
        for q1 in ends:  # joint 2 free
            wrist = target - l1 * np.exp(1j * q1)
            for flip in (0.0, math.pi):
                candidates.append((q1, direction(wrist) - q1 - direction(tail) + flip, q3))
            candidates += [(q1, q2, q3) for q2 in ends]
        for q2 in ends:  # joint 1 free
            whole = l1 + np.exp(1j * q2) * tail
            for flip in (0.0, math.pi):
                candidates.append((direction(target) - direction(whole) + flip, q2, q3))
    for q1 in ends:
        wrist = target - l1 * np.exp(1j * q1)
        for fold in (0.0, math.pi):  # joints 2 and 3 free
            for flip in (0.0, math.pi):
                candidates.append((q1, direction(wrist) - q1 + flip, fold + 0 * u))
        for q2 in ends:  # joint 3 free
            elbow = wrist - l1 * np.exp(1j * (q1 + q2))
            for flip in (0.0, math.pi):
                candidates.append((q1, q2, direction(elbow) - q1 - q2 + flip))
    for q2 in ends:  # joints 1 and 3 free
        upper = l1 + l1 * np.exp(1j * q2)
        for fold in (0.0, math.pi):
            for flip in (0.0, math.pi):
                candidates.append((direction(target) - direction(upper) + flip, q2, direction(upper) - q2 + fold))
    table = np.array([[np.broadcast_to(angle, n) for angle in q] for q in candidates])
    table = math.pi - (math.pi - table) % (2 * math.pi)
    allowed = (np.abs(table) <= bound + _ON_LIMIT).all(axis=1)
    tips = links.tip(table.swapaxes(0, 1))
    gap = np.where(allowed, np.hypot(tips[0] - x, tips[1] - y), np.inf)
    chosen = gap.argmin(axis=0)
    return np.asarray(table[chosen, :, np.arange(n)].T)
