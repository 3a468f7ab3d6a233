"""An environment on batches: rows of matrices, and the compiled functions between them.

A batch of n environments is two matrices: the running episodes (what stays the same) and their states, one column for
each environment. A step makes a matrix of outcomes (state, observation, reward, info). The single shell holds matrices
of one column, the vector shell of n; both run the same machine code.
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import Kernel
from tensegrity_envs.compiler.pytree import Schema, as_matrix, is_row
from tensegrity_envs.compiler.threads import Threads
from tensegrity_envs.dynamic_step import DynamicStep
from tensegrity_envs.interface import Interface, Outcome, Sampled
from tensegrity_envs.randomization import Randomization
from tensegrity_envs.simulation.protocol import Episode, State


class InfoEntry(NamedTuple):
    """Where an entry of `info` stands in a matrix of outcomes: in row `first`, or from there to `end`."""

    name: str
    first: int
    end: int | None
    kind: str


class Batch(Interface):
    """The functions of an environment on batches: a column of a matrix is an environment.

    The running episodes (what stays the same) are one matrix, their outcomes another, whose first rows are the states.
    """

    @cached_property
    def _sampled_schemas(self) -> tuple[Schema[Episode], Schema[Any], Schema[Any]]:
        """Schemas of episodes, start configurations and start inputs, which are the same for all samples."""
        sampled = self.sample(np.zeros(1, np.int64), np.zeros(1, np.int64))
        return Schema(sampled.episode), Schema(sampled.configuration), Schema(sampled.inputs)

    @property
    def episodes(self) -> Schema[Episode]:
        """The schema of a matrix of episodes."""
        return self._sampled_schemas[0]

    @cached_property
    def _begin(self) -> Kernel:
        return Kernel(self.initial, *self._sampled_schemas)

    @property
    def outcomes(self) -> Schema[Outcome]:
        """The schema of a matrix of outcomes."""
        return self._begin.result

    @cached_property
    def states(self) -> Schema[State]:
        """The schema of a matrix of states, which are the first rows of a matrix of outcomes."""
        return Schema(self.outcomes.rows.state, is_row, lambda row: row.kind)

    @cached_property
    def _step(self) -> Kernel:
        actions = Schema(tuple(np.zeros(1) for _ in range(self.simulation.action_size)))
        return Kernel(self.transition, self.episodes, self.states, actions)

    @cached_property
    def _motion(self) -> DynamicStep:
        return DynamicStep(self, self.episodes, self.states)

    @cached_property
    def _outcome(self) -> Kernel:
        return Kernel(self.outcome, self.episodes, self.states)

    def begin(self, seed: np.ndarray, episode: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Begin the episodes of the given (seed, episode) pairs, both of shape (n,).

        Returns:
            The matrices of episodes and of outcomes.
        """
        return self.begin_sampled(self.sample(seed, episode))

    def begin_sampled(self, sampled: Sampled) -> tuple[np.ndarray, np.ndarray]:
        """Begin episodes that were sampled; see `begin`."""
        schemas, count = self._sampled_schemas, len(sampled.configuration[0])
        matrices = [schema.pack(part, count) for schema, part in zip(schemas, sampled, strict=True)]
        episodes, outcomes = matrices[0], self._begin(*matrices)
        if self.engine is not None:
            self._motion.begin(self.engine, outcomes)
        if self.randomization.is_noisy:
            outcomes = self._outcome(episodes, self._with_noise(episodes, outcomes, 0))
        return episodes, self.postprocess(episodes, outcomes)

    def step(
        self, episodes: np.ndarray, states: np.ndarray, actions: np.ndarray, threads: Threads | None = None
    ) -> np.ndarray:
        """The outcomes one step later, for actions of shape (action size, n) in [-1, 1].

        Args:
            episodes: matrix of the running episodes.
            states: matrix of states, or of outcomes.
            actions: shape (action size, n).
            threads: that evaluate the kernel of a quasi-static step; None for the caller's alone.
        """
        if threads is None and self._is_one_kernel:
            return self._step(episodes, states, actions)
        if self.randomization.is_noisy:
            states = self._with_noise(episodes, states, 1)
        return self.moved(episodes, states, actions, threads)

    def moved(
        self, episodes: np.ndarray, states: np.ndarray, actions: np.ndarray, threads: Threads | None = None
    ) -> np.ndarray:
        """The same for one who looks ahead: the noise stays what it was, and is not drawn."""
        if self.engine is None:
            given = episodes, states, actions
            outcomes = self._step(*given) if threads is None else threads(self._step, *given)
        else:
            outcomes = self._motion.step(self.engine, episodes, states, actions)
        return as_matrix(self.postprocess(episodes, outcomes))  # which may be anybody's

    @cached_property
    def _is_one_kernel(self) -> bool:
        """Whether a step is that and nothing else."""
        is_changed = type(self).postprocess is not Batch.postprocess
        return self.engine is None and not self.randomization.is_noisy and not is_changed

    def _with_noise(self, episodes: np.ndarray, states: np.ndarray, later: int) -> np.ndarray:
        """The states with the noise of so many steps later."""
        rows = self.states.rows
        states = states[: self.states.size].copy()
        key = episodes[self.episodes.rows.random["noise_key"]]
        noise = slice(rows.noise[0], rows.noise[-1] + 1)
        states[noise] = Randomization.normals(key, states[rows.time] + later, len(rows.noise))
        shares = self.randomization.noise_shares({k: episodes[row] for k, row in self.episodes.rows.random.items()})
        if shares is not None:
            tip = rows.noise[0] + len(rows.tip)
            states[rows.noise[0] : tip] *= shares[0]
            states[tip : rows.noise[-1] + 1] *= shares[1]
        return states

    def evaluate(self, episodes: np.ndarray, states: np.ndarray) -> np.ndarray:
        """The outcomes of being in these states."""
        return self.postprocess(episodes, self._outcome(episodes, states))

    def postprocess(self, episodes: np.ndarray, outcomes: np.ndarray) -> np.ndarray:
        """The outcomes with what compiled code cannot compute, such as look-ups in a table; unchanged here."""
        return outcomes

    @cached_property
    def info_entries(self) -> list[InfoEntry]:
        """The entries of `info`."""
        rows = self.outcomes.rows
        of_state = {
            "stability_margin": rows.state.stability_margin,
            "wrench_margin": rows.state.wrench_margin,
            "failure": rows.state.failure,
            "configuration": rows.state.configuration,
            **({self.input_name: rows.state.inputs} if self.input_name else {}),
        }
        entries = []
        for name, place in (rows.info | of_state).items():
            at = place if isinstance(place, tuple) else (place,)
            entries.append(InfoEntry(name, int(at[0]), int(at[-1]) + 1 if at is place else None, at[0].kind))
        return entries
