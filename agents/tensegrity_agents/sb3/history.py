"""What an agent remembers of the running episode: its last observations and actions, and the first observation.

Under a delay, noise or hidden parameters one observation does not tell what to do; a few of them and what was done
between do. They are appended to the entry "observation" before it is normalized: `AugmentedVecEnv` keeps them while
training, the `state` of `predict` where the agent is used.
"""

from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from tensegrity_agents.controllers.base import beginning


class Past(NamedTuple):
    """What is remembered of n episodes, the latest first.

    Attributes:
        observations: the last k entries "observation", shape (n, k, size).
        actions: the last k actions, shape (n, k, action size); zero before the episode.
        first: the entry "observation" with which the episode began, shape (n, size).
    """

    observations: Any
    actions: Any
    first: Any


def remembered(xp: Any, now: Any, memory: Past, begins: Any) -> tuple[Any, Past]:
    """Observations with the past, and what is remembered of the step until `with_action`.

    Args:
        xp: numpy or torch, whose arrays the others are.
        now: the entries "observation", shape (n, size).
        memory: of the steps before.
        begins: which of them begin an episode, shape (n,).

    Returns:
        Shape (n, size + History.size), and the memory.
    """
    new, n = begins[:, None, None], now.shape[0]  # `len` is no symbol of a traced batch
    before = xp.where(new, now[:, None], memory.observations)
    actions = xp.where(new, xp.zeros_like(memory.actions), memory.actions)
    first = xp.where(begins[:, None], now, memory.first)
    parts = [now, (now[:, None] - before).reshape(n, -1), actions.reshape(n, -1), first]
    told = xp.concatenate(parts, axis=1)
    return told, Past(xp.concatenate([now[:, None], before[:, :-1]], axis=1), actions, first)


def with_action(xp: Any, memory: Past, latest: Any) -> Past:
    """The past with the actions within [-1, 1], shape (n, action size), that were taken now."""
    return memory._replace(actions=xp.concatenate([latest[:, None], memory.actions[:, :-1]], axis=1))


class History:
    """Appends the past of an episode to its observations.

    For every one of the last k steps, the difference of the present entry "observation" from the one then, and the
    action taken there; after these, the first one of the episode. Before an episode there was no motion and no action.

    Args:
        length: k, how many steps are remembered; at least 1.
        observation_size: of the entry "observation".
        action_size: of the actions.
    """

    def __init__(self, length: int, observation_size: int, action_size: int) -> None:
        self.length, self.observation_size, self.action_size = length, observation_size, action_size
        self.size = length * (observation_size + action_size) + observation_size

    @classmethod
    def of(cls, length: int, observation_space: spaces.Dict, action_space: spaces.Box) -> "History":
        """The history of environments with these spaces."""
        sizes = [int(np.prod(space.shape or ())) for space in (observation_space["observation"], action_space)]
        return cls(length, *sizes)

    def space(self, space: spaces.Dict) -> spaces.Dict:
        """The observation space with the past."""
        size = self.observation_size + self.size
        return spaces.Dict({**space.spaces, "observation": spaces.Box(-np.inf, np.inf, (size,), np.float32)})

    def __call__(
        self, observation: dict[str, Any], memory: Past | None = None, begins: np.ndarray | None = None
    ) -> tuple[dict[str, Any], Past]:
        """The observation or batch of n observations with the past.

        Args:
            observation: Dict of arrays.
            memory: what `acted` returned with the action before; None at first.
            begins: which of them begin an episode, shape (n,); by default none, but all without a memory.

        Returns:
            The observation, and what to hand to `acted` with the action that follows.
        """
        single = np.ndim(observation["observation"]) == 1
        now = np.atleast_2d(np.asarray(observation["observation"], np.float32))
        n = len(now)
        fresh = beginning(n, memory, begins)
        if memory is None:
            memory = Past(
                np.zeros((n, self.length, self.observation_size), np.float32),
                np.zeros((n, self.length, self.action_size), np.float32),
                np.zeros((n, self.observation_size), np.float32),
            )
        told, later = remembered(np, now, memory, fresh)
        return {**observation, "observation": told[0] if single else told}, later

    def applied(self, memory: Past, actions: np.ndarray) -> np.ndarray:
        """What is done where the agent says this: this."""
        return actions

    def acted(self, memory: Past, actions: np.ndarray) -> Past:
        """The past with the actions, shape (n, action size) or of one environment, that were taken now."""
        latest = np.clip(np.reshape(actions, (-1, self.action_size)), -1.0, 1.0).astype(np.float32)
        return with_action(np, memory, latest)
