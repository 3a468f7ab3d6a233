"""What the nominal analytic model tells an agent beside the observation, for those whose config asks for it.

Hints are functions of the observations of an episode so far and the nominal design, both of which every analytic
controller has, too; they are appended to the entry "observation" before it is normalized.
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from tensegrity_agents.controllers import planar_four_bar
from tensegrity_agents.controllers.base import beginning


def _planar_four_bar(core: Any) -> planar_four_bar.Hints:
    loaded = any(core.sampler.load_range)
    return planar_four_bar.LoadedHints(core) if loaded else planar_four_bar.Hints(core)


# By the name of the environment's arm: makes, for a core, what has `size` and tells so many numbers of an observation.
HINTS: dict[str, Callable[[Any], Any]] = {"PlanarFourBarReach": _planar_four_bar}


class Hints:
    """Appends the hints of an environment to its observations.

    Args:
        env_id: Gymnasium id.
        options: of the environment.

    Raises:
        ValueError: there are no hints for it.
    """

    def __init__(self, env_id: str, options: dict[str, Any] | None = None) -> None:
        env: Any = gym.make(env_id, **(options or {})).unwrapped
        arm = gym.spec(env_id).kwargs["arm"]
        if arm not in HINTS:
            known = [i for i in gym.registry if i.startswith("tensegrity/") and gym.spec(i).kwargs.get("arm") in HINTS]
            raise ValueError(f"model_hints: there are none for {env_id}; there are for {', '.join(sorted(known))}")
        self._of_arm = HINTS[arm](env.core)
        env.close()

    def space(self, space: spaces.Dict) -> spaces.Dict:
        """The observation space with hints."""
        size = int(np.prod(space["observation"].shape or ())) + self._of_arm.size
        return spaces.Dict({**space.spaces, "observation": spaces.Box(-np.inf, np.inf, (size,), np.float32)})

    def __call__(
        self, observation: dict[str, Any], memory: Any = None, begins: np.ndarray | None = None
    ) -> tuple[dict[str, Any], Any]:
        """The observation or batch of n observations with hints.

        Args:
            observation: Dict of arrays.
            memory: that the call with the observations before has returned; None at first.
            begins: which of them begin an episode, shape (n,); by default all.

        Returns:
            The observation, and what to remember: a NamedTuple of arrays (n, ...), or None.
        """
        single = np.ndim(observation["observation"]) == 1
        batch = {key: np.atleast_2d(value) for key, value in observation.items()}
        told, memory = self._of_arm(batch, memory, beginning(len(batch["observation"]), memory, begins))
        told = np.concatenate([batch["observation"], told], axis=1).astype(np.float32)
        return {**observation, "observation": told[0] if single else told}, memory

    def acted(self, memory: Any, actions: np.ndarray) -> Any:
        """See `augmented.Augmentation`; actions are not remembered."""
        return memory
