"""A vector environment of Stable-Baselines3 whose observations come with what is remembered of the episode."""

from typing import Any, Protocol

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from tensegrity_agents.controllers.base import rows_of


class Augmentation(Protocol):
    """What appends numbers to the entry "observation", and remembers what it needs for that from step to step."""

    def space(self, space: spaces.Dict) -> spaces.Dict:
        """The observation space with these numbers."""
        ...

    def __call__(
        self, observation: dict[str, Any], memory: Any = None, begins: np.ndarray | None = None
    ) -> tuple[dict[str, Any], Any]:
        """The observation or batch of n observations with these numbers.

        Args:
            observation: Dict of arrays.
            memory: of the step before; None at first.
            begins: which of them begin an episode, shape (n,); by default none, but all without a memory.

        Returns:
            The observation, and what to remember: a NamedTuple of arrays (n, ...), or None.
        """
        ...

    def applied(self, memory: Any, actions: np.ndarray) -> np.ndarray:
        """What is done where the agent says this, shape (n, action size), or that of one environment."""
        ...

    def acted(self, memory: Any, actions: np.ndarray) -> Any:
        """What to remember after this was done, shape (n, action size), or that of one environment."""
        ...


def as_batch(observation: dict[str, Any]) -> dict[str, np.ndarray]:
    """One observation or a batch of n as a batch: arrays (n, ...)."""
    return {key: np.atleast_2d(np.asarray(value, np.float32)) for key, value in observation.items()}


def with_numbers(observation: dict[str, Any], numbers: np.ndarray) -> dict[str, Any]:
    """One observation or a batch of n with these numbers, shape (n, k), at the end of its entry "observation"."""
    told = np.concatenate([np.atleast_2d(np.asarray(observation["observation"], np.float32)), numbers], axis=1)
    return {**observation, "observation": told[0] if np.ndim(observation["observation"]) == 1 else told}


class AugmentedVecEnv(VecEnvWrapper):
    """A vector environment whose observations, terminal ones included, are augmented.

    Attributes:
        memory: of the running episodes.
    """

    def __init__(self, venv: VecEnv, augmentation: Augmentation) -> None:
        assert isinstance(venv.observation_space, spaces.Dict)
        self.augmentation = augmentation
        self.memory: Any = None
        super().__init__(venv, augmentation.space(venv.observation_space))

    def reset(self) -> VecEnvObs:
        """Begin new episodes everywhere."""
        observation: Any = self.venv.reset()
        told, self.memory = self.augmentation(observation)
        return told

    def step_async(self, actions: np.ndarray) -> None:
        """Remember the actions, shape (environments, action size), and hand them on."""
        actions = self.augmentation.applied(self.memory, actions)
        self.memory = self.augmentation.acted(self.memory, actions)
        self.venv.step_async(actions)

    def step_wait(self) -> VecEnvStepReturn:
        """Take the step."""
        observation: Any
        observation, reward, done, infos = self.venv.step_wait()
        ended = np.flatnonzero(done)
        if len(ended):
            last = [infos[i]["terminal_observation"] for i in ended]
            memory = None if self.memory is None else rows_of(self.memory, ended)
            seen = {key: np.stack([one[key] for one in last]) for key in last[0]}
            told, _ = self.augmentation(seen, memory, ~done[ended])
            for row, i in enumerate(ended):
                infos[i]["terminal_observation"] = {key: value[row] for key, value in told.items()}
        told, self.memory = self.augmentation(observation, self.memory, done)
        return told, reward, done, infos
