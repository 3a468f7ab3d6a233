"""What a controller is, and what the analytic ones share: how they read, remember and act."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from tensegrity_agents.controllers.made_for import check_made_for
from tensegrity_agents.controllers.reminder import Reminder
from tensegrity_envs.compiler.namespace import Components
from tensegrity_envs.compiler.pytree import is_array, tree_leaves, tree_map
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation import Episode

Observation = Mapping[str, np.ndarray]  # the environment's Dict, in batches: arrays of shape (n, ...)
Memory = TypeVar("Memory", bound=tuple[Any, ...])
Batch = TypeVar("Batch")


class Controller(Protocol):
    """Whatever has Stable-Baselines3's `predict`; `begin_episodes` and `check_environment` are optional.

    Observations are the environment's Dict, batched: arrays of shape (n, ...). Actions: shape (n, action size),
    in [-1, 1].

    `begin_episodes(mask, design, privileged)`, where it is defined, is called before the first `predict` of new
    episodes with the mask of the environments that begin one, the nominal design, and None; a controller whose class
    says `wants_privileged = True` (an oracle) gets the running `Episode`s, with their true designs and loads, instead
    of None.

    `check_environment(core)`, where it is defined, is called with the core of the environment before anything else; a
    controller that was made for another one raises a `ValueError` that names both.
    """

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = False,
    ) -> tuple[np.ndarray, Any]:
        """Actions for a batch of observations, and the controller's next state."""
        ...


# By the name of an environment's arm, then by their own: what makes each controller for a core.
Makers = dict[str, dict[str, Callable[[Core], Any]]]


def beginning(count: int, state: object, episode_start: object) -> np.ndarray:
    """Which of `count` environments begin an episode, from the arguments of `predict`.

    As in Stable-Baselines3: without a state all, with a state those that `episode_start` says, by default none.
    """
    if state is None:
        return np.ones(count, bool)
    return np.zeros(count, bool) if episode_start is None else np.asarray(episode_start, bool)


def jacobian_at(mechanism: Any, q: Components) -> np.ndarray:
    """The Jacobian of the tip as arrays, shape (n, axes, joints) [m/rad].

    Args:
        mechanism: a planar one.
        q: joint angles, each of shape (n,) [rad].
    """
    return np.stack([np.stack(row, axis=1) for row in mechanism.jacobian(q)], axis=1)


def rows_of(batch: Batch, index: np.ndarray) -> Batch:
    """Some environments of a batch: the arrays (n, ...) in nested NamedTuples, dicts and designs at `index`."""
    rows: Batch = tree_map(lambda values: values[index], batch, is_array)
    return rows


def with_rows(memory: Memory | None, index: np.ndarray, new: Memory) -> Memory:
    """The memory of a batch in which some environments begin an episode.

    Args:
        memory: arrays (n, ...) in nested NamedTuples; None if all environments begin. It is not written to.
        index: the environments that begin.
        new: their memory, arrays (len(index), ...).
    """
    if memory is None:
        return new
    news = tree_leaves(new, is_array)

    def mixed(values: np.ndarray) -> np.ndarray:
        copy = np.array(values)
        copy[index] = next(news)
        return copy

    merged: Memory = tree_map(mixed, memory, is_array)
    return merged


def rows_where(mask: np.ndarray, chosen: Batch, others: Batch) -> Batch:
    """Of two batches of the same form, the rows of the first where the mask (n,) says so, else those of the second."""
    given = tree_leaves(chosen, is_array)

    def mixed(values: np.ndarray) -> np.ndarray:
        return np.where(mask.reshape(-1, *(1,) * (values.ndim - 1)), next(given), values)

    merged: Batch = tree_map(mixed, others, is_array)
    return merged


class AnalyticController(ABC, Generic[Memory]):
    """Reads the observation, remembers what it needs, acts. Subclasses say how.

    The controller itself keeps nothing of an episode: its memory goes in and out of `predict` as Stable-Baselines3's
    state, a NamedTuple of arrays (n, ...) or of such NamedTuples.

    Args:
        core: of the environment.

    Attributes:
        knows: its information set in words, for tables.
        wants_privileged: whether it asks the evaluation for the true episodes, as oracles do.
        is_told_ranges: whether it uses the ranges of what differs from episode to episode, and so is made for a level
            of uncertainty.
        rate: largest change of an input in one step.
        nominal: the mechanism of the nominal design.
        privileged: the true episodes, for those that ask for them.
    """

    wants_privileged = False
    is_told_ranges = False
    knows = ""

    def __init__(self, core: Core) -> None:
        self.core = core
        self.rate = core.simulation.rate
        self.privileged: Episode | None = None
        self._reminder = Reminder(type(self).__name__)
        self._take(core.design)

    def check_environment(self, core: Core) -> None:
        """Refuse an environment that this controller was not made for.

        Raises:
            ValueError: it would misread it, or believes what is not so; see `made_for.check_made_for`.
        """
        check_made_for(self.core, core, self.is_told_ranges)

    def begin_episodes(self, mask: np.ndarray, design: Any, privileged: Episode | None = None) -> None:
        """Take the nominal design and, if this controller asks for them, the true episodes.

        Raises:
            ValueError: it asks for the true episodes, and the evaluation did not hand them over.
        """
        self._take(design)
        self.privileged = privileged
        if self.wants_privileged:
            _ = self.truth

    def _take(self, design: Any) -> None:
        """Take the nominal design."""
        self.nominal: Any = self.core.mechanism(design)

    def input_bounds(self) -> tuple[float, float]:
        """The lowest and the highest value of an input."""
        simulation: Any = self.core.simulation
        low, high = simulation.bounds(self.nominal)
        return float(low), float(high)

    @property
    def truth(self) -> Episode:
        """The true episodes.

        Raises:
            ValueError: this controller was not given them.
        """
        if self.privileged is None:
            raise ValueError(
                f"{type(self).__name__}: needs the privileged episodes "
                "(evaluate it through tensegrity_agents.evaluation.rollout)"
            )
        return self.privileged

    def true_load(self, index: np.ndarray) -> np.ndarray:
        """The true dead force at the tip of the environments at `index`, shape (len(index), axes) [N]."""
        return columns_of(rows_of(self.truth.load, index), len(index))

    def predict(
        self,
        observation: Observation,
        state: Memory | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Memory]:
        """Actions for a batch of n observations, and what to remember.

        Args:
            observation: arrays of shape (n, ...).
            state: the memory that the call before returned; None at first.
            episode_start: which environments begin an episode, shape (n,); by default none, but all without a state.
            deterministic: there is nothing random here.

        Returns:
            Shape (n, action size), within [-1, 1]; the memory.
        """
        self._reminder(state)
        observed = self.decode(observation)
        begins = np.flatnonzero(beginning(len(observed), state, episode_start))
        memory = state
        if memory is None or len(begins):
            memory = with_rows(memory, begins, self.initial(observed.take(begins), begins))
        return self.act(observed, memory)

    def act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        """Actions within [-1, 1], and what to remember."""
        actions, memory = self._act(observed, memory)
        return np.clip(actions, -1.0, 1.0), memory

    def decode(self, observation: Observation) -> DecodedObservation:
        """The observation in SI units, and what a subclass makes of it."""
        return self.core.schema.decode(observation)

    @abstractmethod
    def initial(self, observed: DecodedObservation, index: np.ndarray) -> Memory:
        """The memory of the environments at `index`, which begin an episode; `observed` are their observations."""

    @abstractmethod
    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        """Actions, which may be larger than 1, and what to remember; `memory` must not be written to."""


def columns_of(components: Sequence[Any], count: int) -> np.ndarray:
    """Components, numbers or arrays (count,), as the columns of an array (count, len(components))."""
    array = np.empty((count, len(components)))
    for axis, component in enumerate(components):
        array[:, axis] = component
    return array


def ragged(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Arrays of different lengths as one object array (n,), as a memory keeps them."""
    array = np.empty(len(parts), object)
    for i, part in enumerate(parts):
        array[i] = part
    return array
