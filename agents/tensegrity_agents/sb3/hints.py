"""What the nominal analytic model tells an agent beside the observation, for those whose config asks for it.

Hints are functions of one observation and the nominal design, both of which every analytic controller has, too; they
are appended to the entry "observation" before it is normalized.
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from tensegrity_agents.controllers import planar_four_bar

# By the name of the environment's arm: makes, for a core, what has `size` and tells so many numbers of an observation.
HINTS: dict[str, Callable[[Any], Any]] = {"PlanarFourBarReach": planar_four_bar.Hints}


class Hints:
    """Appends the hints of an environment to its observations.

    Args:
        env_id: Gymnasium id.

    Raises:
        ValueError: there are no hints for it.
    """

    def __init__(self, env_id: str) -> None:
        env: Any = gym.make(env_id).unwrapped
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

    def __call__(self, observation: dict[str, Any]) -> dict[str, Any]:
        """The observation or batch of observations with hints."""
        single = np.ndim(observation["observation"]) == 1
        batch = {key: np.atleast_2d(value) for key, value in observation.items()}
        told = np.concatenate([batch["observation"], self._of_arm(batch)], axis=1).astype(np.float32)
        return {**observation, "observation": told[0] if single else told}


class HintedVecEnv(VecEnvWrapper):
    """A vector environment of Stable-Baselines3 whose observations, terminal ones included, come with hints."""

    def __init__(self, venv: VecEnv, hints: Hints) -> None:
        assert isinstance(venv.observation_space, spaces.Dict)
        self.hints = hints
        super().__init__(venv, hints.space(venv.observation_space))

    def reset(self) -> Any:
        """Begin new episodes everywhere."""
        return self.hints(self.venv.reset())  # type: ignore[arg-type]

    def step_wait(self) -> Any:
        """Take the step."""
        observation, reward, done, infos = self.venv.step_wait()
        ended = np.flatnonzero(done)
        if len(ended):
            last = [infos[i]["terminal_observation"] for i in ended]
            told = self.hints({key: np.stack([seen[key] for seen in last]) for key in last[0]})
            for row, i in enumerate(ended):
                infos[i]["terminal_observation"] = {key: value[row] for key, value in told.items()}
        return self.hints(observation), reward, done, infos  # type: ignore[arg-type]
