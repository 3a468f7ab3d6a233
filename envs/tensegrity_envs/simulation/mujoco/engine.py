"""MuJoCo as the engine of an environment: matrices with one column for each environment."""

import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tensegrity_envs.compiler.pytree import Schema
from tensegrity_envs.simulation.dynamic import Motion
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.mujoco.model import MujocoModel

_FOR_A_THREAD = 8  # environments that are worth one


class Engine:
    """Simulates n environments for the time of a step.

    Args:
        mechanism: with the nominal parameters.
        dynamics: what it does not tell.

    Attributes:
        model: of these parameters.
        joints: how many coordinates there are; see `MujocoModel`.
        physics_size: numbers in a state.
        motions: schema of a matrix of `Motion`s.
    """

    is_traced = False  # see compiler.numbers.Lifting

    def __init__(self, mechanism: Any, dynamics: Dynamics) -> None:
        self.model = MujocoModel(mechanism, dynamics)
        self.joints = self.model.linkage.size
        self.physics_size = self.model.state_size
        self._models: dict[tuple[float, ...], Any] = {}  # of the running episodes
        row = np.zeros(1)
        self.motions = Schema(Motion((row,) * self.joints, (row,) * self.joints, (row,) * self.physics_size, row, row))
        self._cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

    def __getstate__(self) -> dict[str, Any]:
        """All but the models of other parameters, which are made when they are needed."""
        return vars(self) | {"_models": {}}

    def begin(self, q: np.ndarray, actuation: np.ndarray) -> np.ndarray:
        """States of arms at rest, shape (physics size, n).

        Args:
            q: coordinates, shape (joints, n) [rad].
            actuation: that the actuators have reached, shape (inputs, n).
        """
        low, high = self.model.input_bounds
        return np.ascontiguousarray(self.model.state(q.T, None, np.clip(actuation.T, low, high)).T)

    def move(
        self, physics: np.ndarray, actuation: np.ndarray, loads: np.ndarray, models: list[Any] | None
    ) -> np.ndarray:
        """The matrix of motions, one step later.

        Args:
            physics: shape (physics size, n).
            actuation: tensions [N], free or actuator lengths [m], shape (inputs, n).
            loads: at the tip [N], shape (2, n), in space (3, n).
            models: of every environment, from `models_of`; None for the nominal one.
        """
        model, n = self.model, physics.shape[1]
        if n == 1:
            other = None if models is None else models[0]
            state, diverged = model.advance(physics[:, 0].copy(), actuation[:, 0], loads[:, 0], other)
            return self._motion(state, diverged)[:, None]
        threads = max(1, min(self._cores, n // _FOR_A_THREAD))
        found = model.rollout(physics.T, actuation.T, loads.T, nthread=threads, models=models)
        return self._motion(found.states, found.diverged)

    def _motion(self, states: np.ndarray, diverged: np.ndarray) -> np.ndarray:
        """The matrix of motions of states of shape (n, physics size); a column without n."""
        model = self.model
        error = model.assembly_error(states)
        parts = (model.configuration(states), model.velocity(states), states)
        return np.concatenate([*(part.T for part in parts), diverged[None], error[None]])

    def models_of(
        self, keys: Sequence[tuple[float, ...]], parameters: Callable[[int], tuple[Any, Dynamics]]
    ) -> list[Any]:
        """MuJoCo's model of every environment's parameters; those of the call before are used again.

        Others are let go: an episode's parameters hardly ever come back, and a model has 18 to 50 kB.

        Args:
            keys: tell parameters apart.
            parameters: gives mechanism and dynamics of the environment with that number.
        """
        before, self._models = self._models, {}
        for i, key in enumerate(keys):
            if key not in self._models:
                self._models[key] = before[key] if key in before else self.model.variant(*parameters(i))
        return [self._models[key] for key in keys]
