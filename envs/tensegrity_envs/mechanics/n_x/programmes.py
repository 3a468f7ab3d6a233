"""Stiffest and softest tensions of any routing, by linear programmes; one posture at a time.

The smallest eigenvalue of the stiffness matrix is a concave function of the tensions: for every unit vector v it is at
most v.K(F) v, which is linear in F. Cutting planes [Kelley 1960] therefore find its maximum over all feasible tensions:
each programme's solution adds the plane of its own eigenvector.
"""

from collections.abc import Sequence

import numpy as np

from tensegrity_envs.compiler.namespace import Component, is_symbol, is_tensor, namespace_of
from tensegrity_envs.mechanics.n_x.chain import CableArm
from tensegrity_envs.mechanics.n_x.tensions import Held, moment_table
from tensegrity_envs.mechanics.n_x.zonotope import independent_rows, largest_lower_bound, reduced
from tensegrity_envs.mechanics.x_joints.joint import Joint

_MOST_CUTS = 80
_HOPELESS = -1e20  # of max_tension: below it no lower bound is low enough
_GAP = 1e-9  # of the smallest eigenvalue, relative to the largest entry of the matrix


def extreme(
    arm: CableArm,
    joints: Sequence[Joint],
    holding: Sequence[Held],
    hessian: Sequence[Sequence[Component]],
    stiffest: bool,
) -> tuple[list[Component], Component]:
    """Tensions of any routing and the wrench margin [N]; see `NX.stiffest_tensions`.

    The softest ones are those of the smallest trace of the stiffness matrix.

    Raises:
        TypeError: the components are symbols or tensors.
    """
    n, routing, design = len(joints), arm.routing, arm.design
    table = moment_table(routing, holding)
    moments = tuple(joint.moment for joint in holding)
    flat = [*moments, *(entry for row in table for entry in row if entry is not None), design.max_tension]
    if is_symbol(*flat) or any(is_tensor(value) for value in flat):
        raise TypeError(
            "tensions of a routing that is given as a matrix come from linear programmes: on floats and arrays only; "
            "'per_joint' and 'from_base' have closed forms"
        )
    bound = largest_lower_bound(namespace_of(*flat), table, moments, design.max_tension)
    room = _with_dependent_rows(table, moments, design.max_tension, bound) - design.min_tension
    curvature = [joint.curvatures for joint in joints]
    pulls = [[0.0 if not row[j] else curvature[j][max(row[j], 0)] for row in routing] for j in range(n)]
    parts: list[Component] = [
        *moments,
        *(0.0 if entry is None else entry for row in table for entry in row),
        *(hessian[min(i, j)][max(i, j)] for i in range(n) for j in range(n)),
        *(entry for row in pulls for entry in row),
        design.min_tension + np.where(room > _HOPELESS * design.max_tension, np.minimum(room, 0.0), 0.0),
        design.max_tension,
    ]
    shape = np.broadcast_shapes(*(np.shape(part) for part in parts))
    columns = np.stack([np.broadcast_to(np.asarray(part, float), shape).ravel() for part in parts])
    m = len(routing)
    found = np.array([_programme(column, n, m, stiffest) for column in columns.T])
    if len(shape):
        return list(found.T.reshape(m, *shape)), room
    return [float(tension) for tension in found[0]], room


def _with_dependent_rows(
    table: Sequence[Sequence[Component | None]], moments: Sequence[Component], high: Component, bound: Component
) -> Component:
    """The bound of `largest_lower_bound`, found again where the cables do not act on all joints independently.

    There the set of moments that they give is flat: it has fewer facets than normals are asked for.
    """
    n, m = len(table), len(table[0])
    parts = [*(0.0 if entry is None else entry for row in table for entry in row), *moments, high, bound]
    shape = np.broadcast_shapes(*map(np.shape, parts))
    columns = np.stack([np.broadcast_to(np.asarray(part, float), shape).ravel() for part in parts])
    found = columns[-1].copy()
    for k, column in enumerate(columns.T):
        square, highest = column[: n * m].reshape(n, m), float(column[-2])
        if not np.isfinite(column[:-1]).all() or not independent_rows(square)[1].size:
            continue
        fewer, found[k] = reduced(square, column[n * m : -2], highest), -1e30 * highest
        if fewer is not None:
            rows, right = (part.tolist() for part in fewer)
            found[k] = largest_lower_bound(namespace_of(highest), rows, tuple(right), highest)
    return found.reshape(shape) if shape else float(found[0])


def _programme(column: np.ndarray, n: int, m: int, stiffest: bool) -> np.ndarray:
    moments, rest = column[:n], column[n:]
    table, rest = rest[: n * m].reshape(n, m), rest[n * m :]
    passive, rest = rest[: n * n].reshape(n, n), rest[n * n :]
    pulls, (low, high) = rest[: n * m].reshape(n, m), rest[n * m :]
    return extreme_tensions(table, moments, passive, pulls, float(low), float(high), stiffest)


def extreme_tensions(
    table: np.ndarray,
    moments: np.ndarray,
    passive: np.ndarray,
    pulls: np.ndarray,
    low: float,
    high: float,
    stiffest: bool,
) -> np.ndarray:
    """Tensions F in [low, high] with table @ F = moments and an extreme stiffness matrix passive + diag(pulls @ F).

    Args:
        table: shape (n, m).
        moments: shape (n,).
        passive: shape (n, n).
        pulls: shape (n, m).
        low, high: bounds of the tensions.
        stiffest: of the greatest smallest eigenvalue, else of the smallest trace.

    Returns:
        shape (m,).
    """
    n, m = table.shape
    scale = np.abs(table).sum(axis=1) * high + np.abs(moments)
    scale = np.where(scale > 0, scale, 1.0)  # of a joint that no cable spans and nothing loads
    rows, right = table / scale[:, None], moments / scale
    size = max(float(np.abs(passive).max()), float(np.abs(pulls).sum(axis=1).max() * high))
    trace = pulls.sum(axis=0) / size
    best = _solve(-trace if stiffest else trace, None, None, rows, right, [(low, high)] * m)
    if not stiffest or n == 1:
        return best
    smallest, vector = _smallest(passive + np.diag(pulls @ best), size)
    cuts, offsets = [], []
    for _ in range(_MOST_CUTS):
        # s <= v.(passive + diag(pulls F)) v
        cuts.append(np.append(-(vector**2) @ pulls / size, 1.0))
        offsets.append(float(vector @ passive @ vector) / size)
        equal = np.hstack([rows, np.zeros((n, 1))])
        bounds = [(low, high)] * m + [(None, None)]
        answer = _solve(np.append(np.zeros(m), -1.0), np.array(cuts), np.array(offsets), equal, right, bounds)
        tried, upper = answer[:m], answer[m]
        value, vector = _smallest(passive + np.diag(pulls @ tried), size)
        if value > smallest:
            smallest, best = value, tried
        if upper - smallest <= _GAP:
            break
    return best


def _smallest(matrix: np.ndarray, size: float) -> tuple[float, np.ndarray]:
    values, vectors = np.linalg.eigh(matrix)
    return float(values[0]) / size, vectors[:, 0]


def _solve(
    cost: np.ndarray,
    a: np.ndarray | None,
    b: np.ndarray | None,
    equal: np.ndarray,
    right: np.ndarray,
    bounds: Sequence[tuple[float | None, float | None]],
) -> np.ndarray:
    """A linear programme that has a solution, up to rounding of the equations."""
    from scipy.optimize import linprog  # slow to import, and only needed here

    answer = linprog(cost, A_ub=a, b_ub=b, A_eq=equal, b_eq=right, bounds=bounds, method="highs")
    if answer.x is None:  # feasible by a hair: the nearest tensions that there are
        n = len(right)
        slack = np.hstack([equal, np.eye(n), -np.eye(n)])
        weight = 1e6 * (1 + np.abs(cost).max())
        wide = None if a is None else np.hstack([a, np.zeros((len(a), 2 * n))])
        prices = np.concatenate([cost, np.full(2 * n, weight)])
        answer = linprog(prices, A_ub=wide, b_ub=b, A_eq=slack, b_eq=right, bounds=[*bounds, *[(0, None)] * (2 * n)])
    assert answer.x is not None
    return np.asarray(answer.x[: len(cost)])
