"""The zero of the normalized score."""

import numpy as np

from tensegrity_agents.controllers.base import Observation
from tensegrity_envs.core import Core


class RandomController:
    """Uniform random actions: the zero of the normalized score."""

    knows = "nothing"

    def __init__(self, core: Core, seed: int = 0) -> None:
        self.size = core.simulation.action_size
        self._rng = np.random.default_rng(seed)

    def predict(
        self, observation: Observation, state: object = None, episode_start: object = None, deterministic: bool = True
    ) -> tuple[np.ndarray, None]:
        """Actions (n, size)."""
        return self._rng.uniform(-1.0, 1.0, (len(observation["achieved_goal"]), self.size)), None
