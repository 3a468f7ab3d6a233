"""The zero of the normalized score."""

from typing import Any

import numpy as np

from tensegrity_envs.core import Core


class RandomController:
    """Uniform random actions: the zero of the normalized score."""

    knows = "nothing"

    def __init__(self, core: Core, seed: int = 0) -> None:
        self.size = core.simulation.action_size
        self._rng = np.random.default_rng(seed)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, None]:
        """Actions (n, size)."""
        return self._rng.uniform(-1.0, 1.0, (len(observation["achieved_goal"]), self.size)), None
