"""What the nominal analytic model tells an agent beside the observation, for those whose config asks for it.

Hints are functions of the observations of an episode so far and the nominal design, both of which every analytic
controller has, too; they are appended to the entry "observation" before it is normalized.
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

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


class HintedVecEnv(VecEnvWrapper):
    """A vector environment of Stable-Baselines3 whose observations, terminal ones included, come with hints.

    Attributes:
        memory: what `hints` remember of the running episodes.
    """

    def __init__(self, venv: VecEnv, hints: Hints) -> None:
        assert isinstance(venv.observation_space, spaces.Dict)
        self.hints = hints
        self.memory: Any = None
        super().__init__(venv, hints.space(venv.observation_space))

    def reset(self) -> Any:
        """Begin new episodes everywhere."""
        told, self.memory = self.hints(self.venv.reset())  # type: ignore[arg-type]
        return told

    def step_wait(self) -> Any:
        """Take the step."""
        observation, reward, done, infos = self.venv.step_wait()
        ended = np.flatnonzero(done)
        if len(ended):
            last = [infos[i]["terminal_observation"] for i in ended]
            memory = None if self.memory is None else type(self.memory)(*(part[ended] for part in self.memory))
            told, _ = self.hints({key: np.stack([seen[key] for seen in last]) for key in last[0]}, memory, ~done[ended])
            for row, i in enumerate(ended):
                infos[i]["terminal_observation"] = {key: value[row] for key, value in told.items()}
        told, self.memory = self.hints(observation, self.memory, done)  # type: ignore[arg-type]
        return told, reward, done, infos
