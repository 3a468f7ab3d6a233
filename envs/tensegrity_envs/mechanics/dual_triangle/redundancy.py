"""Which of the configurations with the tip at a target: the optimum of an objective, exact and within joint limits.

[Zhao2021, section III] minimizes (a) the sum, (b) the largest and (c) the sum of squares of the joints' displacements
from a start (the print lost the minus sign of (a) and (c)). Along the self-motion curve the minima of (a) and (b) are
mostly kinks, and joint limits cut the curve into arcs. So every minimum is one of: an end of an arc or a kink of (a),
where one angle is known and the other two follow in closed form; or a local minimum of the curve without limits, which
a golden section search finds from samples of the smooth parametrization (`self_motion`).
"""

import math
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.dual_triangle.self_motion import SINGLE, SelfMotion, self_motions, with_one_angle

Angles = Sequence[np.ndarray] | np.ndarray  # of the three joints [rad], one after the other
Objective = Literal["sum", "max", "squares"]
_OBJECTIVES = ("sum", "max", "squares")
_SAMPLES = 96  # of the curve or curves of one target
_BLOCK = 256  # targets at a time: their samples stay in the cache
_ON_LIMIT = 1e-9  # [rad]: as far beyond its limit as rounding may leave an angle
_BENT = 1.3  # an arc between two samples is at most this much longer than its chord
# of the golden section; kinks of "max" are found to their last digits, elsewhere the minima are flat or known
_ITERATIONS = {"sum": 32, "max": 46, "squares": 32}
_GOLDEN = (math.sqrt(5) - 1) / 2


class Redundancy(NamedTuple):
    """Answer to "which configuration has its tip at the target?", or where there is none, the nearest.

    Attributes:
        configuration: (q1, q2, q3) [rad]; for an unreachable target, of the nearest reachable point.
        objective: its value [rad, or rad^2 for "squares"].
        is_reachable: whether the target is reached within the joint limits.
        nearest: the target, or the reachable point nearest to it, (x, y) [m].
        distance: of `nearest` from the target [m]; 0 where that is reachable.
        stability_margin: of the configuration at the unloaded control law's free lengths, see
            `DualTriangle.stability_margin`.
        wrench_margin: of these free lengths, see `DualTriangle.wrench_margin`; negative where they cannot be realized.
    """

    configuration: Components
    objective: Component
    is_reachable: Component
    nearest: tuple[Component, Component]
    distance: Component
    stability_margin: Component = math.nan
    wrench_margin: Component = math.nan

    @property
    def is_stable_wrench_feasible(self) -> Component:
        """Whether the unloaded control law holds the configuration, in stable equilibrium."""
        return (self.stability_margin > 0) & (self.wrench_margin >= 0)


class Links(NamedTuple):
    """What the kinematics of three segments depends on [m]: x of pivot 1, links 1 and 2, link 3."""

    pivot: float
    long: float
    short: float

    def tip(self, q: Angles) -> tuple[np.ndarray, np.ndarray]:
        """Tip of configurations [m]."""
        t1, t2, t3 = q[0], q[0] + q[1], q[0] + q[1] + q[2]
        return (
            self.pivot + self.long * (np.cos(t1) + np.cos(t2)) + self.short * np.cos(t3),
            self.long * (np.sin(t1) + np.sin(t2)) + self.short * np.sin(t3),
        )


def objective_of(name: str, wraps: bool) -> Callable[[Angles, Angles], np.ndarray]:
    """The objective as a function of configuration and start; where there are no limits, displacements are wrapped.

    Raises:
        ValueError: there is no such objective.
    """
    if name not in _OBJECTIVES:
        raise ValueError(f"objective = {name!r}: must be one of {', '.join(_OBJECTIVES)}")

    def displacement(q: Component, start: Component) -> Component:
        move = q - start
        if wraps:
            move = np.pi - np.abs(np.pi - np.abs(move) % (2 * np.pi))
        return np.abs(move)

    def value(q: Angles, start: Angles) -> np.ndarray:
        m1, m2, m3 = (displacement(qi, si) for qi, si in zip(q, start, strict=True))
        if name == "sum":
            return np.asarray(m1 + m2 + m3)
        if name == "max":
            return np.asarray(np.maximum(np.maximum(m1, m2), m3))
        return np.asarray(m1 * m1 + m2 * m2 + m3 * m3)

    return value


def resolve(
    links: Links, x: np.ndarray, y: np.ndarray, start: np.ndarray, objective: str, limit: np.ndarray
) -> Redundancy:
    """`DualTriangle.redundancy` on arrays: targets of shape (n,), start three of them, limit [rad] of shape (n,)."""
    search = _Search(links, x, y, start, objective, limit)
    search.offer_known_angles()
    for index, curve in self_motions(x, y, *links):
        search.search(index, curve)
    q, value, reached = search.q, search.best, np.isfinite(search.best)
    nearest = np.stack([x, y])
    missed = np.flatnonzero(~reached)
    if len(missed):
        q[:, missed] = nearest_configurations(links, x[missed], y[missed], limit[missed])
        nearest[:, missed] = links.tip(q[:, missed])
        value[missed] = search.measure(q[:, missed], start[:, missed])
    distance = np.hypot(nearest[0] - x, nearest[1] - y)
    return Redundancy((q[0], q[1], q[2]), value, reached, (nearest[0], nearest[1]), distance)


def _within(q: Angles, limit: np.ndarray) -> np.ndarray:
    return np.asarray((np.abs(q[0]) <= limit) & (np.abs(q[1]) <= limit) & (np.abs(q[2]) <= limit))


class _Search:
    """The best configuration of every target so far, and what can still improve on it."""

    def __init__(
        self, links: Links, x: np.ndarray, y: np.ndarray, start: np.ndarray, objective: str, limit: np.ndarray
    ) -> None:
        self.links, self.x, self.y, self.start, self.objective, self.limit = links, x, y, start, objective, limit
        self.limited = bool(np.isfinite(limit).any())
        self.measure = objective_of(objective, not self.limited)
        self.bound = limit + _ON_LIMIT
        self.best = np.full(len(x), np.inf)
        self.q = np.zeros((3, len(x)))

    def offer(self, owner: np.ndarray, candidates: Angles, allowed: np.ndarray) -> None:
        """Candidates of every target in `owner` (each once), of shape (targets, any number)."""
        values = np.where(allowed, self.measure(candidates, self.start[:, owner, None]), np.inf)
        column = values.argmin(axis=1)
        row = np.arange(len(owner))
        better = values[row, column] < self.best[owner]
        chosen, row, column = owner[better], row[better], column[better]
        self.best[chosen] = values[row, column]
        for component, candidate in zip(self.q, candidates, strict=True):
            component[chosen] = candidate[row, column]

    def offer_known_angles(self) -> None:
        """The ends of the arcs that the limits leave of the curves, and the kinks of "sum"."""
        everyone = np.arange(len(self.x))
        for joint in range(3):
            given = [-self.limit, self.limit] if self.limited else []
            if self.objective == "sum":
                given.append(self.start[joint])
            if not given:
                continue
            angles = np.stack(given, axis=1)
            angles = np.where(np.isfinite(angles), angles, 0.0)
            for found, exists in with_one_angle(self.x[:, None], self.y[:, None], *self.links, joint, angles):
                self.offer(everyone, found, exists & _within(found, self.bound[:, None]))

    def search(self, index: np.ndarray, curve: SelfMotion) -> None:
        """Sample the curves of the targets `index`, and refine what may hold a better minimum."""
        brackets = [self._brackets(index, curve, part) for part in _parts(len(index), _BLOCK)]
        row, loop, middle, floor = (np.concatenate(values) for values in zip(*brackets, strict=True))
        left = floor <= self.best[index[row]]
        row, loop, middle = row[left], loop[left], middle[left]
        width = 2 * math.pi / (_SAMPLES if curve.kind == SINGLE else _SAMPLES // 2)
        for part in _parts(len(row), 4096):
            self._refine(index, curve, row[part], loop[part], middle[part], width)

    def _brackets(self, index: np.ndarray, curve: SelfMotion, part: slice) -> tuple[np.ndarray, ...]:
        """Local minima among the samples of a block of targets that may lead below the best value so far.

        Returns the targets, loop and s of the samples, and a bound of the objective between their neighbours.
        """
        rows = np.arange(len(index))[part]
        loop, s, before, after = curve.grid(_SAMPLES)
        q = curve.at(rows[:, None], loop, s)
        owner = index[rows]
        values = self.measure(q, self.start[:, owner, None])
        self.offer(owner, q, _within(q, self.bound[owner, None]))
        row, column = np.nonzero((values <= values[:, before]) & (values < values[:, after]))
        here = np.stack([component[row, column] for component in q])
        excess = np.abs(here).max(axis=0) - self.bound[owner[row]]
        # In its own norm (1, infinity or 2) the objective (the root of "squares") changes by no more than the arc.
        root = np.sqrt if self.objective == "squares" else np.asarray
        middle, floor, room = root(values[row, column]), np.full(len(row), np.inf), np.zeros(len(row))
        for neighbour in (before[column], after[column]):
            step = np.abs(np.stack([component[row, neighbour] for component in q]) - here)
            step = np.minimum(step, 2 * math.pi - step)
            room = np.maximum(room, step.max(axis=0))
            if self.objective == "squares":
                arc = np.sqrt((step * step).sum(axis=0))
            else:
                arc = step.sum(axis=0) if self.objective == "sum" else step.max(axis=0)
            beside = root(values[row, neighbour])
            floor = np.minimum(floor, np.maximum((middle + beside - _BENT * arc) / 2, 0.0))
        if self.objective == "squares":
            floor = floor * floor
        left = (excess <= _BENT * room) & (floor <= self.best[owner[row]])
        row, column = row[left], column[left]
        return rows[row], loop[column], s[column], floor[left]

    def _refine(
        self, index: np.ndarray, curve: SelfMotion, row: np.ndarray, loop: np.ndarray, middle: np.ndarray, width: float
    ) -> None:
        """Golden section search, of all brackets at once; a kink is a minimum like any other."""
        owner = index[row]
        start = self.start[:, owner]

        def at(place: np.ndarray) -> np.ndarray:
            return self.measure(curve.at(row, loop, place), start)

        low, high = middle - width, middle + width
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        at_left, at_right = at(left), at(right)
        for _ in range(_ITERATIONS[self.objective]):
            go_left = at_left <= at_right
            low, high = np.where(go_left, low, left), np.where(go_left, right, high)
            inner = np.where(go_left, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
            value = at(inner)
            left, right = np.where(go_left, inner, right), np.where(go_left, left, inner)
            at_left, at_right = np.where(go_left, value, at_right), np.where(go_left, at_left, value)
        found = curve.at(row, loop, np.where(at_left <= at_right, left, right))
        values = np.where(_within(found, self.bound[owner]), self.measure(found, start), np.inf)
        order = np.lexsort((values, owner))  # of several minima of one target the best comes first
        _, first = np.unique(owner[order], return_index=True)
        chosen = order[first]
        self.offer(
            owner[chosen],
            tuple(component[chosen, None] for component in found),
            np.isfinite(values[chosen])[:, None],
        )


def _parts(count: int, size: int) -> list[slice]:
    return [slice(first, min(first + size, count)) for first in range(0, max(count, 1), size)]


def nearest_configurations(links: Links, x: np.ndarray, y: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Configurations within the limits whose tips are nearest to unreachable targets, shape (3, n).

    At the nearest point every angle is at a limit, or the line from its pivot to the tip passes through the target: all
    combinations are tried, each of which is a closed form.
    """
    u, v, bound = x - links.pivot, y, limit
    n = len(u)
    target = u + 1j * v
    candidates: list[Components] = []
    ends = [np.zeros(n)] if not np.isfinite(bound).any() else [-bound, bound]
    l1, l3 = links.long, links.short

    def direction(value: np.ndarray) -> np.ndarray:
        return np.asarray(np.angle(value))

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
