"""Objectives with kinks as programmes of smooth pieces. Derived here.

An objective is a sum of t_g, where t_g is the largest of the pieces of group g: "sum" has a group for each joint,
"max" one of 2 n pieces, "squares" one smooth piece. Barriers are functions that must not be negative. A programme is
solved by sequential quadratic programming (SLSQP) with the pieces as constraints; what it ends at is moved onto the
equations that are active there (the tip, limits, kinks, barriers) by Newton's method. `optimality` decides whether that
is a local optimum.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

Table = Callable[[np.ndarray, np.ndarray], np.ndarray]  # configurations (n, k) and a frame (any, w) -> values (p, k)

_STEP = 1e-6  # [rad] of differences
_ACTIVE = 1e-6  # [rad], or of the values: what is no further apart is equal
_NEWTON = 8  # steps
_FAR = 1e-3  # [rad]: what is active is no further away
_MOST_PIECES = 48  # and as many barriers, that a programme has as constraints
_ROUNDS = 12  # of programmes, with other pieces or another frame each
_BETWEEN = 8  # unit vectors between the eigenvectors of the two smallest eigenvalues, and these
_HELD = 1e-9  # of pieces and barriers that a programme did not have


@dataclass(frozen=True)
class Problem:
    """Which configuration with the tip at a target has the least objective.

    Attributes:
        arm: with `tip`, `jacobian` and `reach`, of one design.
        target: (x, y) [m].
        limit: of the joint angles [rad].
        measure: the objective of configurations (n, k) itself, infinite beyond barriers; shape (k,).
        pieces: of the objective, in units in which they are about 1.
        group: of each piece, shape (p,); None where they are all of one.
        barriers: what must not be negative, over the reach, or None.
        frame: what the pieces take as unit vectors and the like at a configuration (n,), shape (any, w).
        is_smooth: whether the pieces have no kinks of their own, so that their derivatives decide what is an optimum.
    """

    arm: Any
    target: tuple[float, float]
    limit: float
    measure: Callable[[np.ndarray], np.ndarray]
    pieces: Table
    group: np.ndarray | None
    barriers: Callable[[np.ndarray], np.ndarray] | None = None
    frame: Callable[[np.ndarray], np.ndarray] = lambda q: np.eye(len(q))
    is_smooth: bool = True

    def groups(self, values: np.ndarray) -> np.ndarray:
        """The group of each piece, from 0 on, of a table of their values."""
        return np.zeros(len(values), int) if self.group is None else self.group

    def error(self, q: np.ndarray) -> np.ndarray:
        """Of the tip, over the reach; shape (2,)."""
        return np.asarray(np.subtract(self.arm.tip(tuple(q.tolist())), self.target)) / float(self.arm.reach)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Of `error`, shape (2, n)."""
        return np.array(self.arm.jacobian(tuple(q.tolist())), float) / float(self.arm.reach)


def slopes(f: Callable[[np.ndarray], np.ndarray], q: np.ndarray) -> np.ndarray:
    """Derivatives (p, n) of a function of configurations (n, k), by central differences."""
    n = len(q)
    moved = f(q[:, None] + _STEP * np.hstack([np.eye(n), -np.eye(n)]))
    return np.asarray((moved[:, :n] - moved[:, n:]) / (2 * _STEP))


def unit_vectors(matrix: np.ndarray) -> np.ndarray:
    """Unit vectors (n, w): the eigenvectors of a symmetric matrix (n, n), and mixtures of the first two of them.

    The smallest eigenvalue is at most v.H v for every v, so that the eigenvectors give it, and their mixtures what is
    nearby.
    """
    vectors = np.linalg.eigh(matrix)[1]
    angle = np.pi * np.arange(1, _BETWEEN) / _BETWEEN
    return np.hstack([vectors, np.outer(vectors[:, 0], np.cos(angle)) + np.outer(vectors[:, 1], np.sin(angle))])


def displacements(objective: str, start: np.ndarray) -> tuple[Table, np.ndarray]:
    """Pieces and groups of the objectives "sum", "max" and "squares" of the displacements from a start (n,)."""
    n = len(start)

    def moves(q: np.ndarray, frame: np.ndarray) -> np.ndarray:
        return np.concatenate([q - start[:, None], start[:, None] - q])

    def squares(q: np.ndarray, frame: np.ndarray) -> np.ndarray:
        return np.asarray(((q - start[:, None]) ** 2).sum(axis=0, keepdims=True))

    if objective == "squares":
        return squares, np.zeros(1, int)
    return moves, np.tile(np.arange(n), 2) if objective == "sum" else np.zeros(2 * n, int)


class Active(NamedTuple):
    """What holds a configuration with the equals sign.

    Attributes:
        limits: joints that are at one.
        pieces: those that are the largest of their group.
        group: of each of these.
        barriers: those that are zero.
        frame: of the pieces.
    """

    limits: np.ndarray
    pieces: np.ndarray
    group: np.ndarray
    barriers: np.ndarray
    frame: np.ndarray


def active_at(problem: Problem, q: np.ndarray) -> Active:
    """What is active at a configuration (n,)."""
    frame = problem.frame(q)
    values = problem.pieces(q[:, None], frame)[:, 0]
    group = problem.groups(values)
    pieces = np.flatnonzero(values > _largest(values, group)[group] - _ACTIVE)
    blocked = np.zeros(0, int)
    if problem.barriers is not None:
        blocked = np.flatnonzero(problem.barriers(q[:, None])[:, 0] < _ACTIVE)
    return Active(np.flatnonzero(problem.limit - np.abs(q) < _ACTIVE), pieces, group[pieces], blocked, frame)


def equations(problem: Problem, active: Active) -> Callable[[np.ndarray], np.ndarray]:
    """What is zero where the same kinks and barriers are active, a function of configurations (n, k)."""
    first = np.unique(active.group, return_index=True)[1]
    others = np.setdiff1d(np.arange(len(active.pieces)), first)
    reference = first[np.searchsorted(active.group[first], active.group[others])]

    def zeros(q: np.ndarray) -> np.ndarray:
        values = problem.pieces(q, active.frame)[active.pieces]
        kinks = values[others] - values[reference]
        if problem.barriers is None or not len(active.barriers):
            return np.asarray(kinks)
        return np.concatenate([kinks, problem.barriers(q)[active.barriers]])

    return zeros


def snapped(problem: Problem, q: np.ndarray, active: Active) -> np.ndarray:
    """The configuration beside q (n,) on all that is active, to the last digits; q itself where none is found."""
    zeros, joints = equations(problem, active), active.limits
    ends, eye = problem.limit * np.sign(q[joints]), np.eye(len(q))[joints]
    here, rest = q, np.inf
    for _ in range(_NEWTON):
        off = np.concatenate([problem.error(here), here[joints] - ends, zeros(here[:, None])[:, 0]])
        rest = np.abs(off).max()
        if rest < 1e-14:
            break
        table = np.vstack([problem.jacobian(here), eye, slopes(zeros, here)])
        here = here - np.linalg.lstsq(table, off, rcond=1e-9)[0]
    here = np.clip(here, -problem.limit, problem.limit)
    here[joints] = ends
    is_found = rest < 1e-11 and np.abs(here - q).max() < _FAR and np.abs(problem.error(here)).max() < 1e-12
    return here if is_found else q


def solve(problem: Problem, q: np.ndarray) -> np.ndarray:
    """Where programmes lead to from a configuration (n,), moved onto what is active there.

    A programme that ends nowhere better, for pieces that it did not have, is tried again within a shorter way.
    """
    longest, value = np.inf, problem.measure(q[:, None])[0]
    for _ in range(_ROUNDS):
        end, totals = _programme(problem, q, longest)
        values = problem.pieces(end[:, None], problem.frame(end))[:, 0]
        is_held = (_largest(values, problem.groups(values)) <= totals + _HELD).all()
        if is_held and (problem.barriers is None or problem.barriers(end[:, None]).min() >= -_HELD):
            q = end
            break
        reached = problem.measure(end[:, None])[0]
        if np.isfinite(value) and not reached < value:
            longest = np.abs(end - q).max() / 4
        else:
            q, value = end, reached
    return snapped(problem, q, active_at(problem, q))


def _largest(values: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Of each group."""
    return np.array([values[group == g].max() for g in range(group.max() + 1)])


def _programme(problem: Problem, q: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Where one programme ends, shape (n,), and what it takes for the largest piece of each group there.

    Joints turn by `longest` at most [rad]. Of many pieces and barriers it has those that are nearest to being active
    at its start.
    """
    from scipy.optimize import minimize  # slow to import, and only needed here

    n, frame, barriers = len(q), problem.frame(q), problem.barriers
    values = problem.pieces(q[:, None], frame)[:, 0]
    group = problem.groups(values)
    largest = _largest(values, group)
    rows = np.argsort(largest[group] - values, kind="stable")[:_MOST_PIECES]
    more = 0 if len(values) == len(largest) else len(largest)
    slack = np.eye(len(largest))[group[rows]]

    def chosen(z: np.ndarray) -> np.ndarray:
        return problem.pieces(z, frame)[rows]

    def widened(table: np.ndarray) -> np.ndarray:
        return np.hstack([table, np.zeros((len(table), more))])

    constraints: list[Any] = [
        {"type": "eq", "fun": lambda z: problem.error(z[:n]), "jac": lambda z: widened(problem.jacobian(z[:n]))}
    ]
    if more:
        constraints.append(
            {
                "type": "ineq",
                "fun": lambda z: slack @ z[n:] - chosen(z[:n, None])[:, 0],
                "jac": lambda z: np.hstack([-slopes(chosen, z[:n]), slack]),
            }
        )
    if barriers is not None:
        near = np.argsort(barriers(q[:, None])[:, 0], kind="stable")[:_MOST_PIECES]
        constraints.append(
            {
                "type": "ineq",
                "fun": lambda z: barriers(z[:n, None])[near, 0],
                "jac": lambda z: widened(slopes(lambda p: barriers(p)[near], z[:n])),
            }
        )
    price = np.concatenate([np.zeros(n), np.ones(more)])

    def value(z: np.ndarray) -> float:
        return float(price @ z) if more else float(chosen(z[:, None]).sum())

    def slope(z: np.ndarray) -> np.ndarray:
        return np.asarray(price if more else slopes(chosen, z).sum(axis=0))

    first = np.concatenate([q, largest[:more]])
    limits = (np.clip(edge, -problem.limit, problem.limit).tolist() for edge in (q - longest, q + longest))
    bounds: list[tuple[float | None, float | None]] = [*zip(*limits, strict=True), *[(None, None)] * more]
    options: Any = {"ftol": 1e-14, "maxiter": 100} if problem.is_smooth else {"ftol": 1e-10, "maxiter": 60}
    found = minimize(value, first, jac=slope, bounds=bounds, constraints=constraints, method="SLSQP", options=options)
    return np.asarray(found.x[:n]), np.asarray(found.x[n:] if more else [found.fun])
