"""How far an arm is from the obstacles that are observed, and steps that keep off them."""

from functools import cached_property
from typing import Any

import numpy as np

from tensegrity_envs.compiler.kernel import Kernel
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.compiler.pytree import Schema
from tensegrity_envs.core import Core
from tensegrity_envs.environments.obstacles import ObstacleCore
from tensegrity_envs.environments.obstacles.sampling import discs_of
from tensegrity_envs.geometry.clearance import Disc, clearance
from tensegrity_envs.observation import DecodedObservation

KEPT = 0.01  # of the reach: clearance along a planned path, and of a step
_CHANGE = 1e-5  # [rad] for differences
_SHARES = np.array([1.0, 0.7, 0.5, 0.3, 0.15, 0.0])  # of a step
_LOOKS = 4  # along a step


class Clearing:
    """Clearances of the nominal arm.

    Attributes:
        space: of the environment, in which places are told.

    Args:
        core: of the environment.

    Raises:
        TypeError: it has no obstacles.
    """

    def __init__(self, core: Core) -> None:
        if not isinstance(core, ObstacleCore):
            raise TypeError(f"{type(core).__name__}: has no obstacles")
        self._core, self.space = core, core.space

    @cached_property
    def _kernel(self) -> Kernel:
        core, one, space = self._core, np.zeros(1), self.space
        nominal, own = core.nominal, core.own
        known = () if isinstance(core.obstacles, int) else core.obstacles
        fixed = tuple(obstacle for obstacle in known if not isinstance(obstacle, Disc))
        schemas = Schema((one,) * (space.size + space.kept)), Schema((one,) * (3 * core.disc_count))

        def gap(place: Components, discs: Components) -> Component:
            q, inputs = space.posture(place)
            return clearance(nominal, q, (*discs_of(discs), *fixed), inputs, own)

        return Kernel(gap, *schemas)

    def discs(self, observed: DecodedObservation) -> np.ndarray:
        """x, y and radius of each disc, (3 * discs, n) [m]."""
        n, count = len(observed), self._core.disc_count
        if not count:
            return np.zeros((0, n))
        numbers = np.concatenate(
            [observed.obstacle_centres.reshape(n, count, 2), observed.obstacle_radii.reshape(n, count, 1)], axis=2
        )
        return numbers.reshape(n, 3 * count).T

    def __call__(self, q: np.ndarray, discs: np.ndarray) -> np.ndarray:
        """Least clearances, (n,) [m].

        Args:
            q: configurations (joints, n) [rad], or other coordinates of the environment's `space`.
            discs: of each of them, or the same (3 * discs, 1) for all [m].
        """
        return np.array(self._kernel(q, np.array(np.broadcast_to(discs, (len(discs), q.shape[1]))))[0])

    def gradient(self, q: np.ndarray, discs: np.ndarray) -> np.ndarray:
        """Derivatives of the clearance by the joint angles, (joints, n) [m/rad], by central differences."""
        n, rows = q.shape[1], []
        for j in range(len(q)):
            change = np.zeros_like(q)
            change[j] = _CHANGE
            both = self(np.concatenate([q + change, q - change], axis=1), np.tile(discs, 2))
            rows.append((both[:n] - both[n:]) / (2 * _CHANGE))
        return np.stack(rows)

    def kept_off(self, q: np.ndarray, step: np.ndarray, discs: np.ndarray, least: float) -> np.ndarray:
        """As much of joint steps as keeps clear of the obstacles, or comes no nearer to them.

        Args:
            q: configurations (joints, n) [rad].
            step: wanted, likewise.
            discs: (3 * discs, n) [m].
            least: clearance to keep [m].
        """
        n = q.shape[1]
        here = np.minimum(self(q, discs), least)
        taken = np.zeros(n)
        for share in _SHARES[::-1]:
            looks = share * np.arange(1, _LOOKS + 1) / _LOOKS
            along = (q[:, None] + looks[:, None] * step[:, None]).reshape(len(q), -1)
            gaps = self(along, np.tile(discs, _LOOKS)).reshape(_LOOKS, n).min(axis=0)
            taken = np.where(gaps >= here, share, taken)
        return np.asarray(taken * step)


class KeepsOff:
    """What the pseudo-inverse does among obstacles, with whatever arm: it stands before the arm's own in the bases.

    Attributes:
        near: clearance from which on the null space leads away from obstacles, over the reach.
        push: joint step away from an obstacle that is touched [rad].
    """

    knows = "the nominal design and the obstacles; feedback of the tip error"
    near = 0.06
    push = 0.08

    def __init__(self, core: Core) -> None:
        further: Any = super()
        further.__init__(core)
        self.clearing, self.reach = Clearing(core), core.reach

    def push_away(self, q: np.ndarray, discs: np.ndarray) -> np.ndarray:
        """Joint steps (n, joints) [rad] away from obstacles that are near configurations (n, joints) [rad].

        With c the clearance, they are push (1 - c / near) grad c / |grad c|.
        """
        gap, slope = self.clearing(q.T, discs), self.clearing.gradient(q.T, discs)
        share = np.clip(1.0 - gap / (self.near * self.reach), 0.0, 1.0)
        return np.asarray((self.push * share * slope / np.maximum(np.linalg.norm(slope, axis=0), 1e-9)).T)

    def kept_off(self, q: np.ndarray, step: np.ndarray, discs: np.ndarray) -> np.ndarray:
        """As much of joint steps (n, joints) [rad] as keeps clear of the obstacles."""
        return self.clearing.kept_off(q.T, step.T, discs, KEPT * self.reach).T
