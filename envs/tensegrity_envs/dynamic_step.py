"""The step of a dynamic simulation: a compiled first part, the engine, a compiled last part."""

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_envs.compiler.kernel import Kernel
from tensegrity_envs.compiler.pytree import Schema, is_row, tree_leaves
from tensegrity_envs.interface import Interface
from tensegrity_envs.simulation.dynamic import DynamicControl
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.protocol import Episode, State

if TYPE_CHECKING:
    from tensegrity_envs.simulation.mujoco.engine import Engine

_VARIED = ("mass", "damping", "friction", "bandwidth")  # what of the dynamics may be randomized


class DynamicStep:
    """The step of a batch of environments that an engine moves.

    Args:
        core: whose functions are compiled.
        episodes: schema of a matrix of episodes.
        states: schema of a matrix of states.
    """

    def __init__(self, core: Interface, episodes: Schema[Episode], states: Schema[State]) -> None:
        self._core, self.episodes, self.states = core, episodes, states

    @cached_property
    def _command(self) -> Kernel:
        actions = Schema(tuple(np.zeros(1) for _ in range(self._core.simulation.action_size)))
        return Kernel(self._core.command, self.episodes, self.states, actions)

    @cached_property
    def _finish(self) -> Kernel:
        assert self._core.engine is not None
        return Kernel(self._core.finish_step, self.episodes, self.states, self._core.engine.motions)

    def begin(self, engine: "Engine", outcomes: np.ndarray) -> None:
        """Put the engine's state of arms at rest into a matrix of outcomes."""
        simulation, nominal = self._core.simulation, self._core.nominal
        assert isinstance(simulation, DynamicControl)
        rows = self.states.rows
        inputs = tuple(outcomes[list(rows.inputs)])
        actuation = np.stack(simulation.actuation(nominal, inputs))
        u = simulation.coordinates(nominal, tuple(outcomes[list(rows.configuration)]), inputs)
        outcomes[list(rows.physics)] = engine.begin(np.stack(u), actuation)

    def step(self, engine: "Engine", episodes: np.ndarray, states: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """The outcomes one step later; see `Batch.step`."""
        commands = self._command(episodes, states, actions)
        physics, actuation, load = self._told
        motion = engine.move(commands[physics], commands[actuation], commands[load], self._models(engine, episodes))
        return self._finish(episodes, commands[: self.states.size], motion)

    @cached_property
    def _told(self) -> list[slice]:
        """Rows of the matrix of commands that the engine is told: its state, the actuation and the load."""
        rows = self._command.result.rows
        return [slice(part[0], part[-1] + 1) for part in (rows.state.physics, rows.actuation, rows.load)]

    @cached_property
    def _varied(self) -> list[int]:
        """Rows of the matrix of episodes on which a simulation's parameters depend."""
        rows = self.episodes.rows
        random = [row for name, row in rows.random.items() if name in _VARIED]
        return [int(row) for row in (*tree_leaves(rows.design, is_row), *random)]

    def _models(self, engine: "Engine", episodes: np.ndarray) -> list[Any] | None:
        """The engine's model of every episode; None where all are the same."""
        if not self._varied:
            return None
        keys = episodes[self._varied].T.tolist()
        return engine.models_of([tuple(key) for key in keys], lambda i: self._parameters(episodes[:, i]))

    def _parameters(self, column: np.ndarray) -> tuple[Any, Dynamics]:
        """Mechanism and dynamics of an episode."""
        episode = self.episodes.unpack(column)
        own = self._core.dynamics
        assert own is not None
        factors = {name: episode.random[name] for name in _VARIED if name in episode.random}
        return self._core.mechanism(episode.design), own.varied(factors)
