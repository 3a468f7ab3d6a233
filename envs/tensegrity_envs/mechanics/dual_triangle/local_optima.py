"""Local optima among the configurations of an arm of any number of segments with the tip at a target. Derived here.

Two segments have two solutions. Three move along curves while the tip rests, on which points walk downhill
(`n_x.redundancy.walk`). More move on surfaces of n - 2 dimensions: many starts slide downhill along random directions
that leave the tip where it is (J d = 0), all at once; one of each group of those that met, or nearly so (of the 12 best
groups, 5 of the margin), is the start of a sequential quadratic programme, in which the kinks of the objective are
constraints. Maxima of the margin tend to lie where the two smallest eigenvalues of the stiffness matrix meet, a kink
that is no smooth constraint and beside which programmes end; simplices (Nelder and Mead) in the n - 2 free directions
go on from there, again and again until nothing is gained. That these are all local optima is no theorem: tests compare
with searches from 200 starts.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.dual_triangle.inverse import wrap
from tensegrity_envs.mechanics.n_x.redundancy import Measure, measure_of, programme, project, shortest_step, walk

STARTS = 64
_SLIDES = 120
_FIRST_STEP, _LAST_STEP = 0.2, 1e-4  # [rad] of a slide
GROUP = 0.05  # [rad]: slides that end as near together are taken for one
_MOST_GROUPS = {"sum": 12, "max": 12, "squares": 12, "margin": 5}  # of a target: the best ones
SAME = 1e-4  # [rad]: optima that are no further apart are one
_SIMPLEX = 0.01  # [rad]: its first edges
_MOST_SIMPLICES, _ENOUGH = 8, 1e-9  # of margins: who gains less has arrived
_WORST = 1e3  # more than any negative margin


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


def ascended(
    arm: Any, q: np.ndarray, target: tuple[float, float], measure: Measure, limit: float
) -> tuple[np.ndarray, float]:
    """Where simplices in the free directions lead to from a configuration (n,), and the value there.

    Args:
        arm: of four segments or more.
        q: with the tip at the target.
        target: (x, y) [m].
        measure: of the margin, which depends on no start.
        limit: of the joint angles [rad].
    """
    from scipy.optimize import minimize  # slow to import, and only needed here

    place, owner = (np.array([target[0]]), np.array([target[1]])), np.zeros(1, int)

    def moved(z: np.ndarray, free: np.ndarray, rounds: int) -> tuple[np.ndarray, float]:
        found, there = project(arm, (here + free @ z)[:, None], *place, limit, rounds)
        reached = float(measure(found, owner)[0]) if there[0] else _WORST
        return found[:, 0], reached if np.isfinite(reached) else _WORST

    def loss(z: np.ndarray, free: np.ndarray) -> float:
        return moved(z, free, 6)[1]

    here, value = q, float(measure(q[:, None], owner)[0])
    for _ in range(_MOST_SIMPLICES):
        free = np.linalg.svd(np.array(arm.jacobian(tuple(here.tolist()))))[2][2:].T
        simplex = _SIMPLEX * np.vstack([np.zeros(free.shape[1]), np.eye(free.shape[1])])
        options: Any = {"initial_simplex": simplex, "xatol": 1e-9, "fatol": 1e-12, "maxiter": 400}
        found = minimize(loss, simplex[0], args=(free,), method="Nelder-Mead", options=options)
        better, reached = moved(found.x, free, 8)
        if not reached < value:
            break
        gain, here, value = value - reached, better, reached
        if gain < _ENOUGH:
            break
    return here, value


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
        owner, q, value = owner[best], q[:, best], value[best]
        ends = [
            programme(arm, column, (float(x[i]), float(y[i])), start[:, i], objective, load, limit)
            for i, column in zip(owner, q.T, strict=True)
        ]
        found, there = project(arm, np.array(ends).T, x[owner], y[owner], limit, 8)
        after = measure(found, owner)
        keep = there & (after <= value)
        q, value = np.where(keep, found, q), np.where(keep, after, value)
        if objective == "margin":
            for k, i in enumerate(owner):
                q[:, k], value[k] = ascended(arm, q[:, k], (float(x[i]), float(y[i])), measure, limit)
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
