"""Controllers of the dual-triangle arm among obstacles."""

from abc import abstractmethod
from functools import cached_property

import numpy as np

from tensegrity_agents.controllers import dual_triangle
from tensegrity_agents.controllers.base import jacobian_at
from tensegrity_agents.controllers.dual_triangle.planning import schedules
from tensegrity_agents.controllers.dual_triangle.reach import STEPS, ReachController
from tensegrity_agents.controllers.obstacles.clearing import KeepsOff
from tensegrity_agents.controllers.obstacles.planning import PathPlanner
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation

_TABLE, _ENDS = 20_000, 400  # postures, and those of them that are projected onto a target
_SHARE = 0.95  # of the joint limits
_ROUNDS, _DAMPING = 12, 1e-3  # of Newton's method; [m/rad]


class _Along(ReachController):
    """Goes along a joint path to a posture that holds the target. Subclasses say which.

    Raises:
        TypeError: there are no obstacles in the environment.
    """

    any_segments = True

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.planner = PathPlanner(core)

    def _plan(self, observed: DecodedObservation, start: np.ndarray, index: np.ndarray) -> np.ndarray:
        discs = self.planner.clearing.discs(observed).T
        paths = []
        for q, target, around in zip(start, observed.target, discs, strict=True):
            paths.append(np.array([q, *(self._path(q, self.postures(target), around) or [q])]))
        plans = schedules(self.nominal, paths, np.zeros((len(paths), 2)), self.rate, STEPS)
        return np.asarray(np.clip(plans, -self.bound, self.bound))

    @cached_property
    def _table(self) -> tuple[np.ndarray, np.ndarray]:
        """Random postures (k, segments) within the limits, and their tips (k, 2)."""
        limit = _SHARE * float(self.nominal.design.joint_limit)
        q = np.random.default_rng(0).uniform(-limit, limit, (_TABLE, self.nominal.segments))
        return q, np.stack(self.nominal.tip(tuple(q.T)), axis=1)

    def postures(self, target: np.ndarray) -> np.ndarray:
        """Postures (k, segments) [rad] with the tip at a target (2,) [m]: the nearest of a table, projected by Newton's
        method with the least change of the joint angles.
        """
        table, tips = self._table
        q = table[np.argsort(np.hypot(*(tips - target).T))[:_ENDS]]
        limit = _SHARE * float(self.nominal.design.joint_limit)
        for _ in range(_ROUNDS):
            off = target - np.stack(self.nominal.tip(tuple(q.T)), axis=1)
            jacobian = jacobian_at(self.nominal, tuple(q.T))
            across = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING**2 * np.eye(2)
            change = jacobian.transpose(0, 2, 1) @ np.linalg.solve(across, off[..., None])
            q = np.clip(q + np.clip(change[..., 0], -0.3, 0.3), -limit, limit)
        off = target - np.stack(self.nominal.tip(tuple(q.T)), axis=1)
        return np.asarray(q[np.hypot(*off.T) < 0.1 * self.core.task.tolerance])

    @abstractmethod
    def _path(self, start: np.ndarray, ends: np.ndarray, discs: np.ndarray) -> list[np.ndarray]:
        """Postures to visit from `start` (segments,), the last one of `ends` (k, segments) [rad]."""


class StraightPath(_Along):
    """Goes straight, in joint space, to the nearest posture that holds the target."""

    knows = "the nominal design; straight to the nearest posture, takes no notice of the obstacles"

    def _path(self, start: np.ndarray, ends: np.ndarray, discs: np.ndarray) -> list[np.ndarray]:
        """See `_Along._path`."""
        held = ends[self.planner.core.sampler.inside(self.nominal, tuple(ends.T))]
        return list(held[np.abs(held - start).max(axis=1).argmin()][None]) if len(held) else []


class PseudoInverse(KeepsOff, dual_triangle.PseudoInverse):
    """Resolved rate with the damped pseudo-inverse; the null space leads away from the nearest obstacle, and a step is
    cut short where it would touch one.
    """

    def joint_step(self, observed: DecodedObservation, q: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """See `dual_triangle.PseudoInverse.joint_step`."""
        step = super().joint_step(observed, q, wanted)
        away = self.push_away(q, self.clearing.discs(observed))
        jacobian = jacobian_at(self.nominal, tuple(q.T))
        moved = (jacobian @ away[..., None])[..., 0]
        return np.asarray(step + away - (np.linalg.pinv(jacobian, rcond=1e-3) @ moved[..., None])[..., 0])

    def allowed(self, observed: DecodedObservation, q: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """See `dual_triangle.PseudoInverse.allowed`."""
        return self.kept_off(q, turn, self.clearing.discs(observed))


class Planner(_Along):
    """Goes along a joint path that is free in the nominal model: straight to a posture that holds the target, or by a
    sampling planner.
    """

    knows = "the nominal design and the obstacles; plans a free joint path"

    def _path(self, start: np.ndarray, ends: np.ndarray, discs: np.ndarray) -> list[np.ndarray]:
        """See `_Along._path`."""
        return self.planner.path(self.nominal, start, ends, discs)
