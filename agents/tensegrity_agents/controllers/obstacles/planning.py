"""Joint paths among obstacles: straight to one of the solutions of the target, or by a sampling planner."""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np

from tensegrity_agents.controllers.connecting import DRAWS, connect
from tensegrity_agents.controllers.obstacles.clearing import KEPT, Clearing
from tensegrity_envs.observation import DecodedObservation

_STRAIGHT = 32  # solutions, the nearest ones, to which the straight path is looked at
_SPACING = 0.01  # [rad] of the looks along an edge
_FINE = 1e-3  # [rad] of the looks at a path before it is handed out
# Draws of one search after another. Of five joints a path through a narrow passage takes up to 20,000.
_DRAWS = DRAWS, DRAWS, DRAWS, 40_000


class PathPlanner:
    """Plans in the set in which the nominal mechanism can be held, clear of the obstacles by 1 % of the reach.

    Args:
        core: of the environment.
    """

    def __init__(self, core: Any) -> None:
        self.core, self.clearing, self.kept = core, Clearing(core), KEPT * core.reach
        self.space = self.clearing.space

    def is_free(self, model: Any, q: np.ndarray, discs: np.ndarray, kept: float) -> np.ndarray:
        """Whether places (coordinates, k) are free by so much [m]; one `model`, `discs` of shape (numbers, 1)."""
        free = np.abs(q[: self.space.size]).max(axis=0) <= self.space.limit
        near = np.flatnonzero(free)
        near = near[self.clearing(q[:, near], discs) >= kept]
        held = self.space.inside(model, np.zeros(len(near), int), tuple(q[:, near]))
        free[:] = False
        free[near] = held
        return np.asarray(free)

    def path(self, model: Any, start: np.ndarray, ends: np.ndarray, discs: np.ndarray) -> list[np.ndarray]:
        """A joint path from a configuration to one of several others, or a path in other coordinates of the `space`.

        Args:
            model: one mechanism.
            start: (joints,) [rad].
            ends: (k, joints) [rad], free or not.
            discs: x, y and radius of each, (3 * discs,) [m].

        Returns:
            The configurations to visit one after another; empty where no path was found.
        """
        around, same = discs[:, None], start[self.space.size :, None]
        kept = min(self.kept, float(self.clearing(start[:, None], around)[0]))
        start, ends = start[: self.space.size], ends[:, : self.space.size]

        def is_free(q: np.ndarray) -> np.ndarray:
            place = np.concatenate([q, np.repeat(same, q.shape[1], axis=1)]) if len(same) else q
            return self.is_free(model, place, around, kept)

        ends = ends[is_free(ends.T)] if len(ends) else ends
        ends = ends[np.argsort(np.abs(ends - start).max(axis=1), kind="stable")]
        for end in ends[:_STRAIGHT]:
            if self.is_path_free(is_free, start, [end], _SPACING) and self.is_path_free(is_free, start, [end], _FINE):
                return [end]
        limit = self.space.limit
        for seed, draws in enumerate(_DRAWS):
            found = connect(is_free, start, ends, limit, seed, _SPACING, draws)
            if found and self.is_path_free(is_free, start, found, _FINE):
                return found
        return []

    @staticmethod
    def is_path_free(
        is_free: Callable[[np.ndarray], np.ndarray], start: np.ndarray, path: list[np.ndarray], spacing: float
    ) -> bool:
        """Whether a whole path is free at looks so far apart [rad]."""
        points = [start, *path]
        legs = []
        for a, b in zip(points, path, strict=False):
            count = max(2, int(np.ceil(np.abs(b - a).max() / spacing)) + 1)
            legs.append(a[:, None] + np.linspace(0.0, 1.0, count) * (b - a)[:, None])
        return bool(is_free(np.concatenate(legs, axis=1)).all())


class PlansFreePaths:
    """What the closed form of an arm of X-joints becomes with the planner, before which it stands in the bases."""

    knows = "the nominal design and the obstacles; plans a free joint path"
    nominal: Any

    def __init__(self, core: Any) -> None:
        further: Any = super()
        further.__init__(core)
        self.planner = PathPlanner(core)

    @abstractmethod
    def solutions_of(self, target: np.ndarray) -> list[np.ndarray]:
        """The inverse solutions, (k, joints) [rad] each, of targets (n, 2) [m]."""

    def _paths(self, model: object, start: np.ndarray, observed: DecodedObservation) -> list[np.ndarray]:
        discs = self.planner.clearing.discs(observed).T
        ends = self.solutions_of(observed.target)
        found = [self.planner.path(self.nominal, *one) for one in zip(start, ends, discs, strict=True)]
        return [np.array(path or [q]) for path, q in zip(found, start, strict=True)]
