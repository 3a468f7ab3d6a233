"""A controller in a single environment, step by step: for windows, films and records."""

from typing import Any

import numpy as np

from tensegrity_agents.controllers.base import Controller
from tensegrity_agents.evaluation.rollout import announce, check_environment


class Player:
    """Lets a controller act in a single environment.

    Args:
        env: Gymnasium environment of this package, as `gym.make` or a wrapper has it.
        controller: see `controllers.base.Controller`.

    Raises:
        ValueError: the controller was made for another environment.

    Attributes:
        env: likewise.
        observation: the latest one.
        info: likewise.
        ended: whether the episode has.
        failed: whether it has ended by failure, not by its time limit.
    """

    def __init__(self, env: Any, controller: Controller) -> None:
        check_environment(controller, env.unwrapped.core)
        self.env, self._controller = env, controller
        self.observation: dict[str, np.ndarray] = {}
        self.info: dict[str, Any] = {}
        self.ended = self.failed = False
        self._state: Any = None
        self._start = np.ones(1, bool)

    def begin(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Begin an episode, as `reset` of the environment does."""
        self.observation, self.info = self.env.reset(seed=seed, options=options)
        base = self.env.unwrapped
        announce(self._controller, base.design, base.episodes)
        self.ended = self.failed = False
        self._state, self._start = None, np.ones(1, bool)

    def action(self, **seen: np.ndarray) -> np.ndarray:
        """What the controller does now, shape (action size,).

        Args:
            **seen: entries of the observation that the controller is to take for true instead.
        """
        batch = {key: np.asarray(value)[None] for key, value in (self.observation | seen).items()}
        actions, self._state = self._controller.predict(
            batch, state=self._state, episode_start=self._start, deterministic=True
        )
        self._start = np.zeros(1, bool)
        chosen: np.ndarray = np.asarray(actions)[0]
        return chosen

    def step(self, action: np.ndarray | None = None) -> float:
        """One step with an action, by default the controller's; the reward."""
        chosen = self.action() if action is None else action
        self.observation, reward, terminated, truncated, self.info = self.env.step(chosen)
        self.ended, self.failed = bool(terminated or truncated), bool(terminated)
        return float(reward)
