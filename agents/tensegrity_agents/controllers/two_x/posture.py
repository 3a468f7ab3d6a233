"""Analytic controllers for changing the posture of the plain 2-X."""

import math
from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController, ragged
from tensegrity_envs.geometry.aspects import posture_change
from tensegrity_envs.mechanics.two_x import TwoX
from tensegrity_envs.observation import DecodedObservation

_FULL_TURN = 2 * math.pi  # of theta


class Memory(NamedTuple):
    """What a controller carries from step to step, for n environments.

    Attributes:
        path: of each environment, an object array (n,) of waypoints (k, 2), thetas [rad].
        leg: number of the waypoint that was aimed at last, (n,).
    """

    path: np.ndarray
    leg: np.ndarray


def _turn(theta: np.ndarray) -> np.ndarray:
    """The same difference of thetas in [-pi, pi)."""
    return np.asarray((theta + math.pi) % _FULL_TURN - math.pi)


class PostureController(AnalyticController[Memory]):
    """Goes towards something that subclasses choose in every step; by default they plan nothing."""

    nominal: TwoX

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> Memory:
        """See `AnalyticController.initial`."""
        return Memory(ragged([goal[None] for goal in observed.target]), np.zeros(len(index), int))

    def _limited(self, wanted: np.ndarray) -> np.ndarray:
        """Actions towards wanted changes of theta (n, 2) [rad], at the largest rate at most."""
        return np.asarray(wanted / np.maximum(np.abs(wanted).max(axis=1, keepdims=True) / self.rate, 1.0) / self.rate)


class PseudoInverse(PostureController):
    """Resolved rate on the tip error, which is zero from the beginning: the tip of the other posture is where it is."""

    knows = "the design; feedback of the tip error, which cannot see postures"
    damping = 0.02  # [m/rad], of an arm with L = 1 m

    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        q, wanted = tuple(2 * observed.theta.T), tuple(2 * observed.target.T)
        error = np.stack(self.nominal.tip(wanted)) - np.stack(self.nominal.tip(q))
        jacobian: np.ndarray = 2 * np.array(self.nominal.jacobian(q))  # with respect to theta
        square = np.einsum("ikn,jkn->nij", jacobian, jacobian) + self.damping**2 * np.eye(2)
        step = np.einsum("kin,nk->ni", jacobian, np.linalg.solve(square, error.T[..., None])[..., 0])
        return self._limited(step), memory


class StraightPath(PostureController):
    """Straight to the other posture on the torus, the shorter way round, through whatever singularity lies there."""

    knows = "the goal configuration"

    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        return self._limited(_turn(observed.target - observed.theta)), memory


class Planner(PostureController):
    """Plans a path that keeps clear of det J = 0 (`geometry.aspects.posture_change`) and goes along it."""

    knows = "the design; plans around the cusps"

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> Memory:
        """See `AnalyticController.initial`."""
        paths = [self._plan(start, goal) for start, goal in zip(observed.theta, observed.target, strict=True)]
        return Memory(ragged(paths), np.zeros(len(index), int))

    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        change, leg = np.zeros_like(observed.theta), memory.leg.copy()
        for i, (path, theta) in enumerate(zip(memory.path, observed.theta, strict=True)):
            distance = np.abs(_turn(path - theta)).max(axis=1)
            while leg[i] + 1 < len(path) and distance[leg[i] + 1] <= self.rate:
                leg[i] += 1
            change[i] = _turn(path[leg[i]] - theta)
        return self._limited(change), memory._replace(leg=leg)

    def _plan(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Waypoints (k, 2) [rad], the last one the goal."""
        try:
            path = posture_change(
                self.nominal, (2 * start[0], 2 * start[1]), (2 * goal[0], 2 * goal[1]), 2 * math.pi, 2 * _FULL_TURN
            )
        except ValueError:  # a passage narrower than the grid can see
            return goal[None]
        return np.concatenate([path.configurations / 2, goal[None]])
