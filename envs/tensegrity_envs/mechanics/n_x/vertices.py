"""Tensions of least and of greatest stiffness for any routing, one posture at a time.

The compliance along a direction, and so its largest value over all directions, is a convex function of the tensions
(K -> u.K^-1 u is convex where K is positive definite, and K is affine in the tensions). Its minimum over the feasible
tensions is found by any descent, its maximum at a vertex: all of them are enumerated.
"""

from collections.abc import Sequence
from itertools import combinations, product
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.n_x.chain import CableArm
from tensegrity_envs.mechanics.n_x.zonotope import reduced


def vertices(table: np.ndarray, moments: np.ndarray, low: float, high: float) -> np.ndarray:
    """Vertices of {F: table @ F = moments, low <= F <= high}, shape (k, m): all but n tensions are at a bound.

    Where the cables do not act on all n joints independently, all but as many as the rank of the table are.
    """
    fewer = reduced(table, moments, high)
    if fewer is None:
        return np.empty((0, table.shape[1]))
    table, moments = fewer
    n, m = table.shape
    bounds = np.array(list(product((low, high), repeat=m - n))).reshape(2 ** (m - n), m - n)
    found = []
    for basis in combinations(range(m), n):
        rest = [c for c in range(m) if c not in basis]
        square = table[:, basis]
        if abs(np.linalg.det(square)) < 1e-12 * np.prod(np.linalg.norm(table, axis=1)):
            continue
        free = np.linalg.solve(square, moments[:, None] - table[:, rest] @ bounds.T).T
        slop = 1e-9 * high
        inside = ((free >= low - slop) & (free <= high + slop)).all(axis=1)
        corners = np.empty((int(inside.sum()), m))
        corners[:, basis], corners[:, rest] = np.clip(free[inside], low, high), bounds[inside]
        found.append(corners)
    return np.concatenate(found) if found else np.empty((0, m))


def extreme_stiffness(
    arm: CableArm, q: tuple[float, ...], load: Sequence[Component], direction: Sequence[Component] | None
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Tensions of the least and of the greatest stiffness of the tip, see `TipStiffness`."""
    from scipy.optimize import minimize  # slow to import, and only needed here

    low, high = float(arm.design.min_tension), float(arm.design.max_tension)
    table: np.ndarray
    table, moments = np.array(arm.torque_matrix(q)), np.array(arm.passive_gradient(q, load))
    start = arm.stiffest_tensions(q, load)
    corners = vertices(table, moments, low, high)
    if not len(corners):
        return start, start
    values = [arm.stiffness(q, tuple(corner), load, direction) for corner in corners.tolist()]
    soft = tuple(corners[int(np.argmin(values))].tolist())
    size = arm.stiffness(q, start, load, direction)
    if size <= 0:
        return soft, start

    def compliance(tensions: np.ndarray) -> float:
        found = arm.stiffness(q, tuple(tensions.tolist()), load, direction)
        return float(size / found) if found > 0 else 1e3

    scale = np.abs(table).sum(axis=1) * high
    equal: Any = {"type": "eq", "fun": lambda f: (table @ f - moments) / scale, "jac": lambda f: table / scale[:, None]}
    options: Any = {"ftol": 1e-14, "maxiter": 300}
    best, value = start, 1.0
    for begin in (start, tuple(corners[int(np.argmax(values))].tolist())):
        answer = minimize(
            compliance, np.array(begin), bounds=[(low, high)] * len(begin), constraints=[equal], options=options
        )
        off = np.abs(table @ answer.x - moments).max() / scale.max()
        if off < 1e-9 and answer.fun < value:
            best, value = tuple(np.clip(answer.x, low, high).tolist()), float(answer.fun)
        if size / max(values) < value:
            best, value = tuple(corners[int(np.argmax(values))].tolist()), float(size / max(values))
    return soft, best
