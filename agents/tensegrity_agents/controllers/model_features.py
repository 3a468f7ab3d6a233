"""Model-based features: what the nominal model makes of an observation, for agents whose config asks for them.

They are functions of the observations of an episode so far and the nominal design, both of which every analytic
controller has, too; they are appended to the entry "observation" before it is normalized.
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from tensegrity_agents.controllers import FOLDERS, arm_of
from tensegrity_agents.controllers.base import Observation, beginning
from tensegrity_envs.env import unwrapped

# By the name of the environment's arm, as the folders of the mechanisms say.
FEATURES: dict[str, Callable[[Any], Any]] = {
    arm: make for folder in FOLDERS for arm, make in getattr(folder, "FEATURES", {}).items()
}


class ModelFeatures:
    """Appends the model-based features of an environment to its observations.

    Args:
        env_id: Gymnasium id.
        options: of the environment.

    Raises:
        ValueError: there are none for it.
    """

    def __init__(self, env_id: str, options: dict[str, Any] | None = None) -> None:
        env = unwrapped(gym.make(env_id, **(options or {})))
        arm = arm_of(env_id, options)
        if arm not in FEATURES:
            known = [
                i for i in gym.registry if i.startswith("tensegrity/") and gym.spec(i).kwargs.get("arm") in FEATURES
            ]
            raise ValueError(f"model_hints: there are none for {env_id}; there are for {', '.join(sorted(known))}")
        self._of_arm = FEATURES[arm](env.core)
        env.close()

    def space(self, space: spaces.Dict) -> spaces.Dict:
        """The observation space with features."""
        size = int(np.prod(space["observation"].shape or ())) + self._of_arm.size
        return spaces.Dict({**space.spaces, "observation": spaces.Box(-np.inf, np.inf, (size,), np.float32)})

    def __call__(
        self, observation: Observation, memory: Any = None, begins: np.ndarray | None = None
    ) -> tuple[dict[str, Any], Any]:
        """The observation or batch of n observations with features.

        Args:
            observation: Dict of arrays.
            memory: that the call with the observations before has returned; None at first.
            begins: which of them begin an episode, shape (n,); by default none, but all without a memory.

        Returns:
            The observation, and what to remember: a NamedTuple of arrays (n, ...), or None.
        """
        single = np.ndim(observation["observation"]) == 1
        batch = {key: np.atleast_2d(value) for key, value in observation.items()}
        features, memory = self._of_arm(batch, memory, beginning(len(batch["observation"]), memory, begins))
        whole = np.concatenate([batch["observation"], features], axis=1).astype(np.float32)
        return {**observation, "observation": whole[0] if single else whole}, memory

    def applied(self, memory: Any, actions: np.ndarray) -> np.ndarray:
        """What is done where the agent says this: this."""
        return actions

    def acted(self, memory: Any, actions: np.ndarray) -> Any:
        """See `augmented.Augmentation`; actions are not remembered."""
        return memory
