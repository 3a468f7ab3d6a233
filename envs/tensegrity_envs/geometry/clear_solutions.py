"""Inverse solutions that keep clear of obstacles, and the best ones where there is a continuum. Derived here.

Of arms whose solutions are finitely many, all are found and those that touch something left out. Of redundant ones
points of the self-motion move downhill, as for the redundancy without obstacles (`mechanics.optima.search`); what is
not clear counts as worse than everything, so that they stop where an obstacle begins, as they do at joint limits. Of
four joints or more programmes (`mechanics.optima.pieces`) with the parts of the clearance as constraints go on from
there, and what is no local optimum is left out. Components of the clear part of a self-motion that are narrower than
the starts are dense can be missed. Solutions of the planar 4-bar are stable equilibria, and actuator lengths are part
of them: its angles alone do not say where its bars are.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.geometry.clearance import Obstacle, check_obstacles, check_one_each, clearance
from tensegrity_envs.geometry.clearance_parts import clearance_parts
from tensegrity_envs.geometry.own_bars import own_pairs
from tensegrity_envs.mechanics.checks import check_numbers
from tensegrity_envs.mechanics.design import check_one_design
from tensegrity_envs.mechanics.dual_triangle import DualTriangle
from tensegrity_envs.mechanics.dual_triangle.local_optima import problem_of as dual_triangle_problem
from tensegrity_envs.mechanics.dual_triangle.local_optima import starts as triangle_starts
from tensegrity_envs.mechanics.n_x import NX
from tensegrity_envs.mechanics.n_x.local_optima import problem_of as n_x_problem
from tensegrity_envs.mechanics.n_x.postures import postures_at
from tensegrity_envs.mechanics.optima.descent import slide, walk
from tensegrity_envs.mechanics.optima.objectives import Measure, measure_of, of_target
from tensegrity_envs.mechanics.optima.optimality import SAME, grouped, polished
from tensegrity_envs.mechanics.optima.pieces import Problem
from tensegrity_envs.mechanics.optima.search import GROUP
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar
from tensegrity_envs.mechanics.two_x import TwoX

Objective = Literal["clearance", "sum", "max", "squares", "margin"]
CLEARED = (TwoX, NX, DualTriangle, PlanarFourBar)
_OBJECTIVES = ("clearance", "sum", "max", "squares", "margin")
_LARGER_IS_BETTER = ("clearance", "margin")
_STARTS = 200
_SOLVED = 24  # of four joints or more: the best slides, and as many starts, from which programmes start
_ROOM = 1e-9  # of the reach, by which programmes keep clear of `least`


class ClearSolution(NamedTuple):
    """A configuration with the tip at the target, clear of the obstacles.

    Attributes:
        configuration: the joint angles [rad].
        clearance: least signed clearance of any bar [m].
        objective: its value [m for "clearance"; - for "margin"; the others as `start`, squared for "squares"].
        stability_margin: of the stiffest tensions, or of the control law's free lengths, under the load [-].
        wrench_margin: of the same [-].
        lengths: actuator lengths of the planar 4-bar [m]; other arms have none.
    """

    configuration: tuple[float, ...]
    clearance: float
    objective: float
    stability_margin: float
    wrench_margin: float
    lengths: tuple[float, ...] | None = None

    @property
    def is_stable_wrench_feasible(self) -> bool:
        """Whether the configuration can be held under the load."""
        return self.stability_margin > 0 and self.wrench_margin >= 0


def clear_solutions(
    mechanism: Any,
    x: float,
    y: float,
    obstacles: Sequence[Obstacle],
    objective: Objective = "clearance",
    start: Sequence[float] | None = None,
    least: float = 0.0,
    load: Sequence[float] = (0.0, 0.0),
    own_bars: bool = False,
) -> list[ClearSolution]:
    """Configurations within the joint limits with the tip at (x, y) [m] and no bar in an obstacle, the best first.

    Of two joints all of them, and of the planar 4-bar all stable equilibria under the load; of three joints the local
    optima of the objective along the self-motion curves; of more, local optima among all that are clear by more than
    `least`: to first order (Karush, Kuhn and Tucker, with the joint limits and the clearance as constraints), and
    none of a few hundred configurations up to 2e-3 rad away is better, see `mechanics.optima.optimality`. Of the
    "margin" of an n-X with cables that span several joints, whose kinks are not told apart, the latter alone. The first
    is the best of all that was looked at, and is given even if it does not pass. That these are all is not promised.
    Where bars that do not move are nearest, or the tip at the target, all that is as clear is an optimum of the
    "clearance", and some are given. Whether the arm can be held there counts for the "margin" alone; each tells.

    Args:
        mechanism: a `TwoX`, an `NX` or a `DualTriangle` of two joints or more, or a `PlanarFourBar`; of one design.
        x: target [m].
        y: target [m].
        obstacles: one or more; none will do where its own bars count.
        objective: "clearance" or "margin" (the smaller one of stability and wrench margin), to be large; "sum", "max"
            or "squares" of the displacements from `start`, to be small.
        start: joint angles [rad], zero by default; of the 4-bar actuator lengths [m], by default L, half of their
            range.
        least: clearance that solutions exceed [m].
        load: (fx, fy) [N], for margins and for the equilibria of the 4-bar.
        own_bars: whether the mechanism's own bars that can meet count as obstacles, too (`own_bars.own_pairs`).

    Returns:
        The solutions, none where none was found.

    Raises:
        TypeError: the mechanism is none of these, or the obstacles are no sequence of obstacles.
        ValueError: a number is not finite, actuator lengths of the start are out of range, the objective is unknown,
            there are no obstacles, a disc is many, or the mechanism has one joint or is a batch of designs.
    """
    joints = _joints(mechanism)
    is_four_bar = isinstance(mechanism, PlanarFourBar)
    check_one_design(mechanism.design, "clear_solutions")
    begin = (float(mechanism.length) if is_four_bar else 0.0,) * joints if start is None else start
    given = (("target", (x, y), 2), ("start", begin, joints), ("least", (least,), 1), ("load", load, 2))
    for name, numbers, count in given:
        check_numbers(name, numbers, count)
    if is_four_bar:
        mechanism.check_lengths(begin)
    check_obstacles(obstacles)
    check_one_each(obstacles or ())
    if objective not in _OBJECTIVES:
        raise ValueError(f"objective = {objective!r}: must be one of {', '.join(_OBJECTIVES)}")
    pairs = own_pairs(mechanism) if own_bars else ()

    def gap(q: np.ndarray, inputs: Any = None) -> np.ndarray:
        return np.asarray(clearance(mechanism, tuple(q), obstacles, inputs, pairs))

    from_start = np.array(begin, float)[:, None]
    if is_four_bar:
        return _of_four_bar(mechanism, float(x), float(y), objective, from_start, load, gap, least)
    measure = _measure(mechanism, objective, from_start, load, gap, least)
    place = np.array([float(x)]), np.array([float(y)])
    owner, q = _postures(mechanism, *place)
    if not len(owner):
        gap(np.zeros((joints, 1)))  # says what is wrong with the obstacles
        return []
    if joints > 2:
        limit = min(float(mechanism.design.joint_limit), np.pi - 1e-9)
        begun = q[:, np.isfinite(measure(q, owner))]
        none = np.zeros(begun.shape[1], int)
        q, reached = (walk if joints == 3 else slide)(mechanism, begun, none, *place, measure, limit)
        if joints > 3 and (gap(q) > least).any():
            best = grouped(none, q, reached, GROUP, _SOLVED)
            problem_of = dual_triangle_problem if isinstance(mechanism, DualTriangle) else n_x_problem
            target, worth = (float(x), float(y)), of_target(measure)
            problem = problem_of(mechanism, target, from_start[:, 0], objective, load, limit, worth)
            q = polished(
                _clear(problem, objective, obstacles, pairs, least), np.hstack([q[:, best], begun[:, :_SOLVED]])
            )
    gaps, value = gap(q), measure(q, np.zeros(q.shape[1], int))
    index = np.flatnonzero((gaps > least) & np.isfinite(value))
    if joints > 2:
        index = index[grouped(np.zeros(len(index), int), q[:, index], value[index], SAME)]
    else:
        index = index[np.argsort(value[index], kind="stable")]
    sign = -1.0 if objective in _LARGER_IS_BETTER else 1.0
    q, gaps, value = q[:, index], gaps[index], sign * value[index]
    _, stability, wrench = mechanism.posture(tuple(q), tuple(load))
    return _solutions(q, gaps, value, stability, wrench)


def _joints(mechanism: Any) -> int:
    """The number of joints.

    Raises:
        TypeError: the mechanism is none that there are solutions for.
        ValueError: it has one joint.
    """
    if not isinstance(mechanism, CLEARED):
        names = ", ".join(kind.__name__ for kind in CLEARED)
        raise TypeError(f"clear_solutions: {type(mechanism).__name__}: must be one of {names}")
    joints = 2 if isinstance(mechanism, PlanarFourBar) else int(mechanism.degrees_of_freedom)
    if joints < 2:
        raise ValueError("clear_solutions: for two joints or more, not for 1: its tip moves along a curve")
    return joints


def _postures(mechanism: Any, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (n, k) within the limits with the tip at the target, and a zero for each."""
    if isinstance(mechanism, DualTriangle):
        return triangle_starts(mechanism, x, y, float(mechanism.design.joint_limit), _STARTS)
    if isinstance(mechanism, NX):
        return postures_at(mechanism, x, y, _STARTS)
    q = np.array([one.configuration for one in mechanism.inverse_kinematics(float(x[0]), float(y[0]))]).reshape(-1, 2).T
    return np.zeros(q.shape[1], int), q


def _of_four_bar(
    mechanism: PlanarFourBar,
    x: float,
    y: float,
    objective: str,
    start: np.ndarray,
    load: Sequence[float],
    gap: Any,
    least: float,
) -> list[ClearSolution]:
    """The stable equilibria with the tip at the target that are clear by more than `least`, the best first."""
    at_target = [one for one in mechanism.inverse_kinematics(x, y, load) if one.is_stable]
    q = np.array([one.configuration for one in at_target]).reshape(-1, 2).T
    lengths = np.array([one.lengths for one in at_target]).reshape(-1, 2).T
    gaps = gap(q, tuple(lengths))
    stability, wrench = (
        np.asarray(margin(tuple(q), tuple(lengths), load))
        for margin in (mechanism.stability_margin, mechanism.wrench_margin)
    )
    if objective == "clearance":
        value = gaps
    elif objective == "margin":
        value = np.minimum(stability, wrench)
    else:
        value = measure_of(mechanism, objective, start, load)(lengths, np.zeros(q.shape[1], int))
    sign = -1.0 if objective in _LARGER_IS_BETTER else 1.0
    order = np.argsort(sign * value, kind="stable")
    order = order[gaps[order] > least]
    return _solutions(q[:, order], gaps[order], value[order], stability[order], wrench[order], lengths[:, order])


def _solutions(
    q: np.ndarray, gaps: np.ndarray, value: np.ndarray, stability: Any, wrench: Any, lengths: np.ndarray | None = None
) -> list[ClearSolution]:
    """The columns of arrays (n, k) and (k,) as solutions."""
    rows = [np.broadcast_to(part, gaps.shape).tolist() for part in (gaps, value, stability, wrench)]
    inputs = [None] * len(gaps) if lengths is None else [tuple(row) for row in lengths.T.tolist()]
    return [ClearSolution(tuple(c), *rest) for c, *rest in zip(q.T.tolist(), *rows, inputs, strict=True)]


def _measure(
    mechanism: Any, objective: str, start: np.ndarray, load: Sequence[Component], gap: Any, least: float
) -> Measure:
    """What is minimized; infinite where a configuration is not clear, but for the clearance itself."""
    if objective == "clearance":
        return lambda q, owner: -gap(q)
    free = measure_of(mechanism, objective, start, load)

    def measure(q: np.ndarray, owner: np.ndarray) -> np.ndarray:
        return np.where(gap(q) > least, free(q, owner), np.inf)

    return measure


def _clear(
    problem: Problem, objective: str, obstacles: Sequence[Obstacle], own: Sequence[tuple[str, str]], least: float
) -> Problem:
    """The same with the clearance as barriers, or as the objective."""
    size = float(problem.arm.reach)

    def parts(q: np.ndarray) -> np.ndarray:
        return clearance_parts(problem.arm, q, obstacles, own) / size

    if objective == "clearance":
        return replace(problem, pieces=lambda q, frame: -parts(q), group=None)
    return replace(problem, barriers=lambda q: parts(q) - (least / size + _ROOM))
