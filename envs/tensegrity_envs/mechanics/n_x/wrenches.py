"""Feasible wrenches of a posture, exactly: joint torques as a zonotope, tip forces as a polygon."""

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np

from tensegrity_envs.mechanics.n_x.zonotope import check_choices, facet_normals, independent_rows


class Zonotope(NamedTuple):
    """The torques center + generators @ w, w in [-1, 1]^m.

    Attributes:
        center: shape (n,) [N m].
        generators: shape (n, m) [N m], one for each cable.
    """

    center: np.ndarray
    generators: np.ndarray

    def support(self, directions: np.ndarray) -> np.ndarray:
        """The largest direction.torque, for directions of shape (..., n)."""
        return np.asarray(directions @ self.center + np.abs(directions @ self.generators).sum(axis=-1))

    def halfspaces(self) -> tuple[np.ndarray, np.ndarray]:
        """All facets: unit normals (k, n) and offsets (k,); inside is normals @ torque <= offsets.

        Of a flat one, too: where the cables do not act on all joints independently.
        """
        acted, free = independent_rows(self.generators)
        rows = acted.T @ self.generators if free.size else self.generators
        table = [[None if entry == 0 else float(entry) for entry in row] for row in rows]
        found = [[0.0 if v is None else float(v) for v in normal] for normal in facet_normals(table)]
        normals = np.array(found)
        sizes = np.linalg.norm(normals, axis=1)
        normals = normals[sizes > 1e-12 * sizes.max()] / sizes[sizes > 1e-12 * sizes.max(), None]
        normals = np.concatenate([normals @ acted.T, free.T])
        normals = np.concatenate([normals, -normals])
        return normals, self.support(normals)

    def margin(self, torque: np.ndarray) -> float:
        """The distance of a torque from the nearest facet's plane [N m], positive inside."""
        normals, offsets = self.halfspaces()
        return float((offsets - normals @ torque).min())

    @property
    def volume(self) -> float:
        """Its volume [(N m)^n]: the sum of those of all parallelepipeds of n generators."""
        n, m = self.generators.shape
        check_choices(m, n, n)
        return float(sum(abs(np.linalg.det(2 * self.generators[:, some])) for some in combinations(range(m), n)))


def torque_zonotope(table: np.ndarray, low: float, high: float) -> Zonotope:
    """What tensions in [low, high] give through a torque matrix of shape (n, m)."""
    return Zonotope(table.sum(axis=1) * (low + high) / 2, table * (high - low) / 2)


def tip_force_polygon(zonotope: Zonotope, torque: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """The forces f at the tip with torque - jacobian^T f in the zonotope: vertices (k, 2), counter-clockwise [N].

    Of three joints or more it is a slice of the zonotope, by a plane.

    Raises:
        ValueError: the set is not bounded: the tip of one joint, or of a singular posture, can carry any force in some
            direction; or it is flat.
    """
    from scipy.optimize import linprog  # slow to import, and only needed here
    from scipy.spatial import ConvexHull, HalfspaceIntersection  # slow to import, and only needed here

    flat = independent_rows(zonotope.generators)[1].shape[1]
    if flat:
        n, m = zonotope.generators.shape
        raise ValueError(
            f"tip_forces: {m} cables act on {n - flat} of {n} joints independently: what they hold has no area; "
            "must span every joint with as many cables as there are joints, or more"
        )
    normals, offsets = zonotope.halfspaces()
    rows, right = -normals @ jacobian.T, offsets - normals @ torque
    if np.linalg.svd(jacobian, compute_uv=False)[-1] < 1e-9 * np.abs(jacobian).max() or len(torque) < 2:
        raise ValueError("tip_forces: the set is not bounded, since the tip cannot move in every direction")
    sizes = np.linalg.norm(rows, axis=1)
    acts = sizes > 1e-12 * sizes.max()
    if (right[~acts] < -1e-9 * np.abs(offsets).max()).any():
        return np.empty((0, 2))
    rows, right = rows[acts] / sizes[acts, None], right[acts] / sizes[acts]
    # the centre of the largest circle inside
    answer = linprog(
        [0.0, 0.0, -1.0], A_ub=np.column_stack([rows, np.ones(len(rows))]), b_ub=right, bounds=[(None, None)] * 3
    )
    if answer.x is None or answer.x[2] <= 1e-12 * np.abs(right).max():
        return np.empty((0, 2))
    corners: np.ndarray = HalfspaceIntersection(np.column_stack([rows, -right]), answer.x[:2]).intersections
    return np.asarray(corners[ConvexHull(corners).vertices])


def area(polygon: np.ndarray) -> float:
    """Area of a polygon of vertices (k, 2), counter-clockwise."""
    x, y = polygon.T if len(polygon) else np.zeros((2, 1))
    return float(math.fsum((x * np.roll(y, -1) - np.roll(x, -1) * y).tolist()) / 2)
