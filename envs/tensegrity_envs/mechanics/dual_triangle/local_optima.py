"""Local optima among the configurations of an arm of any number of segments with the tip at a target. Derived here.

Two segments have two solutions. Three move along curves, more on surfaces (`optima.search`). Programmes start at all
corners, with n - 2 joints at limits (of "sum" also at rest), of "max" and "margin" where n - 1 joints are equally far,
and at random places of the faces of every dimension (`optima.faces`, `faces`).
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.dual_triangle.faces import completed, equal_corners
from tensegrity_envs.mechanics.dual_triangle.inverse import wrap
from tensegrity_envs.mechanics.dual_triangle.margins import eigenvectors, margin_pieces
from tensegrity_envs.mechanics.optima.faces import corners, faces, held_angles
from tensegrity_envs.mechanics.optima.objectives import measure_of, of_target
from tensegrity_envs.mechanics.optima.pieces import Problem, displacements
from tensegrity_envs.mechanics.optima.projection import project
from tensegrity_envs.mechanics.optima.search import local_optima

STARTS = 64
# Places of the faces of a target that are drawn before two joints are solved for.
_DRAWN = {"sum": 600, "max": 1000, "squares": 400, "margin": 600}


def postures(arm: Any, first: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both configurations (n, k) with the first n - 2 angles (n - 2, k) and the tips at (k,), and their columns."""
    wrist = arm.wrist((x, y), tuple(first))
    reached = np.flatnonzero((wrist.stretch >= 0) & (wrist.folding >= 0))
    both = [np.stack([*first, wrap(arm.before_last(wrist, last)), last]) for last in (wrist.angle, -wrist.angle)]
    return np.hstack([q[:, reached] for q in both]), np.tile(reached, 2)


def starts(arm: Any, x: np.ndarray, y: np.ndarray, limit: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (n, k) within the limits with the tip at the targets (m,), and the indices (k,) of these."""
    n, m, rng = arm.segments, len(x), np.random.default_rng(0)
    owner = np.repeat(np.arange(m), count if n > 2 else 1)
    spread = rng.uniform(-limit, limit, (n, count)) * rng.choice([0.1, 0.5, 1.0], count)
    q, column = postures(arm, np.tile(spread[:-2], m if n > 2 else 1)[:, : len(owner)], x[owner], y[owner])
    inside = (np.abs(q) <= limit).all(axis=0)
    q, found = q[:, inside], owner[column[inside]]
    if n == 2:
        return found, q
    moved, there = project(arm, np.tile(spread, m), x[owner], y[owner], limit)
    return np.concatenate([found, owner[there]]), np.hstack([q, moved[:, there]])


def problem_of(
    arm: Any,
    target: tuple[float, float],
    start: np.ndarray,
    objective: str,
    load: Sequence[Component],
    limit: float,
    measure: Callable[[np.ndarray], np.ndarray],
) -> Problem:
    """The programme of a target and a start (n,), see `optima`; `measure` as in `Problem`."""
    if objective == "margin":
        pieces, frame = margin_pieces(arm, load), lambda q: eigenvectors(arm, q, load)
        return Problem(arm, target, limit, measure, pieces, None, frame=frame)
    return Problem(arm, target, limit, measure, *displacements(objective, start))


def _places(arm: Any, target: tuple[float, float], start: np.ndarray, objective: str, limit: float) -> np.ndarray:
    """Corners and faces (n, any) where programmes start."""

    def complete(q: np.ndarray, pair: tuple[int, int]) -> np.ndarray:
        return completed(arm, q, pair, target)

    values = held_angles(objective, start, limit)
    centre = {"max": start, "margin": np.zeros(len(start))}.get(objective)
    places = [corners(complete, values, limit), faces(complete, values, limit, _DRAWN[objective], centre)]
    if centre is not None:
        places.append(equal_corners(arm, centre, target, limit))
    return np.hstack(places)


def optima(
    arm: Any,
    x: np.ndarray,
    y: np.ndarray,
    start: np.ndarray,
    objective: str,
    load: Sequence[Component],
    limit: float,
    count: int = STARTS,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All local optima that were found: index of the target (k,), configurations (n, k), values (k,), best first.

    Args:
        arm: of two segments or more, of one design.
        x, y: targets of shape (m,) [m].
        start: of the displacements, (n, m) [rad].
        objective: "sum", "max" or "squares", to be small; or "margin", to be large.
        load: (fx, fy) [N], of "margin".
        limit: of the joint angles [rad].
        count: starts for each target.
    """
    measure = measure_of(arm, objective, start, load)

    def problem(i: int) -> Problem:
        value = of_target(measure_of(arm, objective, start[:, [i]], load))
        return problem_of(arm, (float(x[i]), float(y[i])), start[:, i], objective, load, limit, value)

    def places(i: int) -> np.ndarray:
        return _places(arm, (float(x[i]), float(y[i])), start[:, i], objective, limit)

    begun = starts(arm, x, y, limit, count)
    return local_optima(arm, x, y, begun, objective, measure, limit, problem, places)


def nearest(
    arm: Any, x: float, y: float, limit: float, start: np.ndarray, count: int = 24
) -> tuple[np.ndarray, tuple[float, float]]:
    """A configuration (n,) within the limits whose tip is nearest to a target out of reach, and its tip [m]."""
    from scipy.optimize import minimize  # slow to import, and only needed here

    n, size, rng = arm.segments, float(arm.reach), np.random.default_rng(0)

    def gap(q: np.ndarray) -> tuple[float, np.ndarray]:
        here = tuple(q.tolist())
        ex, ey = (a - b for a, b in zip(arm.tip(here), (x, y), strict=True))
        row_x, row_y = (np.array(row) for row in arm.jacobian(here))
        return float((ex * ex + ey * ey) / size**2), 2 * (ex * row_x + ey * row_y) / size**2

    places = [np.clip(start, -limit, limit), *rng.uniform(-limit, limit, (count, n))]
    options: Any = {"ftol": 1e-16, "gtol": 1e-12, "maxiter": 500}
    found = [
        minimize(gap, q, jac=True, bounds=[(-limit, limit)] * n, method="L-BFGS-B", options=options) for q in places
    ]
    best = min(found, key=lambda one: one.fun).x
    px, py = arm.tip(tuple(best.tolist()))
    return np.asarray(best), (float(px), float(py))
