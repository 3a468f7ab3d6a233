"""What is a local optimum among the configurations with the tip at a target, and all that programmes lead to.

A configuration is one if it satisfies the conditions of Karush, Kuhn and Tucker (a linear programme in the joint rates
finds no descent), and if nothing is better among many configurations nearby, in all directions and along those of the
kinks, limits and barriers that it is on which do not make the objective rise.
"""

import numpy as np

from tensegrity_envs.mechanics.optima.pieces import Active, Problem, active_at, slopes, snapped, solve
from tensegrity_envs.mechanics.optima.projection import project

SAME = 1e-4  # [rad]: optima that are no further apart are one
_GAIN = 1e-9  # of the objective: nothing near a local optimum is better by more
_RATE = 1e-5  # of the objective, for joint rates of 1: less is no descent
_NEARBY = (2e-3, 5e-4, 1e-4)  # [rad]
_DIRECTIONS = 100  # for each of these
_LEVEL = 12  # joint rates along which the objective neither rises nor falls


def polished(problem: Problem, q: np.ndarray) -> np.ndarray:
    """The local optima (n, any) that configurations (n, k) lead to, best first; and what is best, if it is none."""
    if not q.shape[1]:
        return q
    ends = np.array([solve(problem, column) for column in q.T]).reshape(-1, len(q)).T
    ends = np.hstack([_at_target(problem, ends), q[:, [problem.measure(q).argmin()]]])
    value = problem.measure(ends)
    ends, value = ends[:, np.isfinite(value)], value[np.isfinite(value)]
    kept = grouped(np.zeros(len(value), int), ends, value, SAME)
    return ends[:, [i for rank, i in enumerate(kept) if rank == 0 or is_optimum(problem, ends[:, i])]]


def grouped(owner: np.ndarray, q: np.ndarray, value: np.ndarray, apart: float, most: int | None = None) -> np.ndarray:
    """Indices of the best configuration of each group, of each target in ascending order of value."""
    order = np.lexsort((value, owner))
    kept: list[int] = []
    for target in np.unique(owner):
        found: list[int] = []
        for i in order[owner[order] == target]:
            if all(np.abs(q[:, i] - q[:, j]).max() > apart for j in found):
                found.append(int(i))
            if most is not None and len(found) == most:
                break
        kept += found
    return np.array(kept, int)


def _at_target(problem: Problem, q: np.ndarray) -> np.ndarray:
    """Those of configurations (n, k) that are within the limits and, some after a few corrections, at the target."""
    (x, y), arm, limit = problem.target, problem.arm, problem.limit
    px, py = arm.tip(tuple(q))
    moved, there = project(arm, q, np.full(len(px), x), np.full(len(px), y), limit, 12)
    as_it_is = np.hypot(px - x, py - y) < 1e-13 * float(arm.reach)
    return np.where(as_it_is, np.clip(q, -limit, limit), moved)[:, as_it_is | there]


class _Rates:
    """Joint rates d up to 1 that tip, limits and barriers allow, and s_g >= the rates of group g's active pieces."""

    def __init__(self, problem: Problem, q: np.ndarray, active: Active) -> None:
        self.active, self.joints, self.groups = active, len(q), int(active.group.max()) + 1
        barriers, blocked = problem.barriers, active.barriers
        self.rising = slopes(lambda p: problem.pieces(p, active.frame)[active.pieces], q)
        self.leaving = np.zeros((0, len(q)))
        if barriers is not None and len(blocked):
            self.leaving = slopes(lambda p: barriers(p)[blocked], q)
        at_limit = np.isin(np.arange(len(q)), active.limits)
        self.bounds: list[tuple[float | None, float | None]] = [
            (0.0 if held and angle < 0 else -1.0, 0.0 if held and angle > 0 else 1.0)
            for held, angle in zip(at_limit, q, strict=True)
        ]
        self.tip = problem.jacobian(q)

    def least(self, price: np.ndarray, most: float | None = None) -> np.ndarray | None:
        """The rates d and s of least price (n + groups,); the sum of s at most `most`."""
        from scipy.optimize import linprog  # slow to import, and only needed here

        none = np.zeros((len(self.leaving), self.groups))
        table = [np.hstack([self.rising, -np.eye(self.groups)[self.active.group]]), np.hstack([-self.leaving, none])]
        right = np.zeros(len(self.rising) + len(self.leaving))
        if most is not None:
            table.append(np.append(np.zeros(self.joints), np.ones(self.groups))[None])
            right = np.append(right, most)
        answer = linprog(
            price,
            A_ub=np.vstack(table),
            b_ub=right,
            A_eq=np.hstack([self.tip, np.zeros((2, self.groups))]),
            b_eq=np.zeros(2),
            bounds=[*self.bounds, *[(None, None)] * self.groups],
        )
        return None if answer.x is None else np.asarray(answer.x)

    def still_active(self, rates: np.ndarray) -> Active:
        """What of all that is active stays so along rates (n + groups,)."""
        d, s, active = rates[: self.joints], rates[self.joints :], self.active
        pieces = self.rising @ d > s[active.group] - _RATE
        return Active(
            active.limits[d[active.limits] == 0],
            active.pieces[pieces],
            active.group[pieces],
            active.barriers[self.leaving @ d < _RATE],
            active.frame,
        )


def is_optimum(problem: Problem, q: np.ndarray) -> bool:
    """Whether a configuration (n,) is a local optimum."""
    rates = _Rates(problem, q, active_at(problem, q))
    price = np.append(np.zeros(rates.joints), np.ones(rates.groups))
    steepest = rates.least(price)
    if problem.is_smooth and (steepest is None or price @ steepest < -_RATE):
        return False
    rng, value = np.random.default_rng(0), float(problem.measure(q[:, None])[0])
    free = np.linalg.svd(rates.tip)[2][2:]
    tried = []
    for step in _NEARBY:
        way = rng.normal(size=(_DIRECTIONS, len(free))) @ free
        way *= step / np.abs(way).max(axis=1, keepdims=True)
        tried.append(np.clip(q + way, -problem.limit, problem.limit).T)
    for _ in range(_LEVEL):
        level = rates.least(np.append(rng.normal(size=rates.joints), np.zeros(rates.groups)), _RATE / 10)
        if level is None or np.abs(level[: rates.joints]).max() < 1e-3:
            continue
        stays, way = rates.still_active(level), level[: rates.joints]
        tried += [
            snapped(problem, np.clip(q + step * way, -problem.limit, problem.limit), stays)[:, None] for step in _NEARBY
        ]
    new = _at_target(problem, np.hstack(tried))
    return not new.shape[1] or bool(problem.measure(new).min() >= value - _GAIN)
