"""Local optima among the configurations of an arm of any number of segments with the tip at a target. Derived here.

Two segments have two solutions. Three move along curves while the tip rests, on which points walk downhill
(`n_x.redundancy.walk`). More move on surfaces of n - 2 dimensions, with edges and corners where joints are at limits,
and kinks. Programmes (`n_x.pieces`) start at all corners, at random places of the faces of every dimension
(`faces`), and where the best of many slides ended: slides go downhill along random directions that leave the tip where
it is (J d = 0). What is no local optimum is left out, but for the best that was found. That these are all local optima
is no theorem: tests compare with searches from 200 starts.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.dual_triangle.faces import corners, equal_corners, faces
from tensegrity_envs.mechanics.dual_triangle.inverse import wrap
from tensegrity_envs.mechanics.dual_triangle.margins import eigenvectors, margin_pieces
from tensegrity_envs.mechanics.n_x.optimality import SAME, grouped, polished
from tensegrity_envs.mechanics.n_x.pieces import Problem, displacements
from tensegrity_envs.mechanics.n_x.redundancy import Measure, measure_of, project, shortest_step, walk

STARTS = 64
_SLIDES = 120
_FIRST_STEP, _LAST_STEP = 0.2, 1e-4  # [rad] of a slide
GROUP = 0.05  # [rad]: slides that end as near together are taken for one
_MOST_GROUPS = {"sum": 12, "max": 12, "squares": 12, "margin": 5}  # of a target: the best ones
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


def slide(
    arm: Any, q: np.ndarray, owner: np.ndarray, x: np.ndarray, y: np.ndarray, measure: Measure, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (n, k) move downhill along random directions that leave the tip at rest; and their values (k,)."""
    size, rng = float(arm.reach), np.random.default_rng(1)
    q, value, step = q.copy(), measure(q, owner), np.full(len(owner), _FIRST_STEP)
    for _ in range(_SLIDES):
        way = rng.normal(size=q.shape)
        jx, jy = (np.stack([np.broadcast_to(e, way[0].shape) for e in row]) for row in arm.jacobian(tuple(q)))
        way = way - shortest_step(arm, q, (jx * way).sum(axis=0), (jy * way).sum(axis=0), size)
        way = way * (step / np.maximum(np.abs(way).max(axis=0), 1e-300))
        improved = np.zeros(len(owner), bool)
        for sign in (1.0, -1.0):
            new, there = project(arm, q + sign * way, x[owner], y[owner], limit, 4)
            tried = np.where(there, measure(new, owner), np.inf)
            better = (tried < value) & ~improved
            q, value = np.where(better, new, q), np.where(better, tried, value)
            improved |= better
        step = np.clip(np.where(improved, 1.5 * step, 0.75 * step), _LAST_STEP, _FIRST_STEP)
    return q, value


def problem_of(
    arm: Any,
    target: tuple[float, float],
    start: np.ndarray,
    objective: str,
    load: Sequence[Component],
    limit: float,
) -> Problem:
    """The programme of a target and a start (n,), see `optima`."""
    free = measure_of(arm, objective, start[:, None], load)

    def measure(q: np.ndarray) -> np.ndarray:
        return free(q, np.zeros(q.shape[1], int))

    if objective == "margin":
        pieces, frame = margin_pieces(arm, load), lambda q: eigenvectors(arm, q, load)
        return Problem(arm, target, limit, measure, pieces, None, frame=frame)
    return Problem(arm, target, limit, measure, *displacements(objective, start))


def _verified(
    arm: Any,
    target: tuple[float, float],
    start: np.ndarray,
    objective: str,
    load: Sequence[Component],
    limit: float,
    slid: np.ndarray,
) -> np.ndarray:
    """Local optima (n, k) that programmes lead to from what slid (n, any), and from faces and corners."""
    kinks = [(at,) if objective == "sum" and abs(at) < limit else () for at in start.tolist()]
    values = [(-limit, limit, *at) for at in kinks]
    centre = {"max": start, "margin": np.zeros(len(start))}.get(objective)
    drawn = faces(arm, values, target, limit, _DRAWN[objective], centre)
    places = [slid, corners(arm, values, target, limit), drawn]
    if centre is not None:
        places.append(equal_corners(arm, centre, target, limit))
    return polished(problem_of(arm, target, start, objective, load, limit), np.hstack(places))


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
    owner, q = starts(arm, x, y, limit, count)
    if arm.segments == 2:
        value = measure(q, owner)
    elif arm.segments == 3:
        q, value = walk(arm, q, owner, x, y, measure, limit)
    elif len(owner):
        q, value = slide(arm, q, owner, x, y, measure, limit)
        best = grouped(owner, q, value, GROUP, _MOST_GROUPS[objective])
        ends = [
            _verified(
                arm, (float(x[i]), float(y[i])), start[:, i], objective, load, limit, q[:, best[owner[best] == i]]
            )
            for i in np.unique(owner)
        ]
        owner = np.repeat(np.unique(owner), [end.shape[1] for end in ends])
        q = np.hstack(ends)
        value = measure(q, owner)
    else:
        value = np.zeros(0)
    kept = grouped(owner, q, value, SAME)
    return owner[kept], q[:, kept], (-value[kept] if objective == "margin" else value[kept])


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
