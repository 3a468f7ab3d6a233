"""Analytic controllers for changing the posture of the plain 2-X."""

import math
from typing import Any

import numpy as np

from tensegrity_envs.core import Core
from tensegrity_envs.mechanics.singularity import posture_change
from tensegrity_envs.mechanics.two_x import TwoX

_FULL_TURN = 2 * math.pi  # of theta


def _turn(theta: np.ndarray) -> np.ndarray:
    """The same difference of thetas in [-pi, pi)."""
    return np.asarray((theta + math.pi) % _FULL_TURN - math.pi)


class _Posture:
    """What these controllers share.

    Args:
        core: of the environment.
    """

    knows = ""

    def __init__(self, core: Core) -> None:
        self.rate = core.simulation.rate
        self.arm: TwoX = core.nominal
        self.paths: dict[int, np.ndarray] = {}

    def begin_episodes(self, mask: np.ndarray, design: Any, privileged: Any = None) -> None:
        """Forget the ways of the episodes before."""
        self.paths = {}

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions (n, 2) for a batch of n observations."""
        here = np.asarray(observation["achieved_goal"], float)
        goal = np.asarray(observation["desired_goal"], float)
        fresh = np.zeros(len(here), bool) if episode_start is None else np.asarray(episode_start, bool)
        return self.step(here, goal, fresh) / self.rate, state

    def step(self, here: np.ndarray, goal: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """Increments of theta (n, 2) [rad]."""
        raise NotImplementedError

    def _towards(self, gap: np.ndarray) -> np.ndarray:
        return np.asarray(gap / np.maximum(np.abs(gap).max(axis=1, keepdims=True) / self.rate, 1.0))


class PseudoInverse(_Posture):
    """Resolved rate on the tip error, which is zero from the beginning: the tip of the other posture is where it is."""

    knows = "the design; feedback of the tip error, which cannot see postures"
    damping = 0.02  # [m/rad], of an arm with L = 1 m

    def step(self, here: np.ndarray, goal: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """See `_Posture.step`."""
        q, wanted = tuple(2 * here.T), tuple(2 * goal.T)
        error = np.stack(self.arm.tip(wanted)) - np.stack(self.arm.tip(q))
        jacobian: np.ndarray = 2 * np.array(self.arm.jacobian(q))  # with respect to theta
        square = np.einsum("ikn,jkn->nij", jacobian, jacobian) + self.damping**2 * np.eye(2)
        return self._towards(np.einsum("kin,nk->ni", jacobian, np.linalg.solve(square, error.T[..., None])[..., 0]))


class StraightPath(_Posture):
    """Straight to the other posture on the torus, the shorter way round, through whatever singularity lies there."""

    knows = "the goal configuration"

    def step(self, here: np.ndarray, goal: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """See `_Posture.step`."""
        return self._towards(_turn(goal - here))


class Planner(_Posture):
    """Plans a way that keeps clear of det J = 0 (`mechanics.singularity.posture_change`) and walks along it."""

    knows = "the design; plans around the cusps"

    def step(self, here: np.ndarray, goal: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """See `_Posture.step`."""
        gap = np.zeros_like(here)
        for i in range(len(here)):
            if fresh[i] or i not in self.paths:
                self.paths[i] = self._plan(here[i], goal[i])
            path = self.paths[i]
            ahead = np.abs(_turn(path - here[i])).max(axis=1)
            k = 0
            while k + 1 < len(path) and ahead[k + 1] <= self.rate:
                k += 1
            self.paths[i] = path[k:]
            gap[i] = _turn(path[k] - here[i])
        return self._towards(gap)

    def _plan(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        try:
            path = posture_change(
                self.arm, (2 * start[0], 2 * start[1]), (2 * goal[0], 2 * goal[1]), 2 * math.pi, 2 * _FULL_TURN
            )
        except ValueError:  # a way narrower than the grid can see
            return goal[None]
        return np.concatenate([path.configurations / 2, goal[None]])
