"""A Gymnasium VectorEnv (SAME_STEP autoreset) as a Stable-Baselines3 VecEnv."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnv


class VectorEnvAdapter(VecEnv):
    """Steps the whole batch with one call; SB3's own wrappers (VecMonitor, VecNormalize) go around it.

    The last observation of an episode is in info["terminal_observation"], and info["TimeLimit.truncated"] says that it
    ended by the time limit alone, so that SB3 bootstraps from its value. Other entries of `info` are handed on only in
    the step in which an episode ends: a list of full dicts for every step would cost more than the physics.

    Args:
        envs: the vector environment.
        stagger: spread the time limits of the first episodes evenly (see the environment's `reset`).

    Raises:
        ValueError: the environment does not reset in the same step.
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any], stagger: bool = False) -> None:
        if envs.metadata.get("autoreset_mode") != AutoresetMode.SAME_STEP:
            raise ValueError(f"{envs}: must have metadata['autoreset_mode'] = AutoresetMode.SAME_STEP")
        self.envs = envs
        self._stagger = stagger
        self._actions: np.ndarray
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> Any:
        """Begin new episodes everywhere, with the seeds given to `seed` if there were any."""
        seeds: Any = None if all(seed is None for seed in self._seeds) else list(self._seeds)
        observation, _ = self.envs.reset(seed=seeds, options={"stagger": True} if self._stagger else None)
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        """Remember the actions."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Take the step."""
        observation, reward, terminated, truncated, info = self.envs.step(self._actions)
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        ended = np.flatnonzero(done)
        if len(ended):
            final_obs, final = info["final_obs"], info["final_info"]
            keys = [key for key in final if not key.startswith("_")]
            for i in ended:
                infos[i] = {key: final[key][i] for key in keys}
                infos[i]["terminal_observation"] = final_obs[i]
                infos[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
        return observation, reward.astype(np.float32), done, infos

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute of the vector environment, once for every index."""
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def has_attr(self, attr_name: str) -> bool:
        """Whether the vector environment has the attribute."""
        return hasattr(self.envs, attr_name)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the vector environment, for all environments at once."""
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method of the vector environment once; its result stands for every index."""
        result = getattr(self.envs, method_name)(*args, **kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No Gymnasium wrappers are inside a native vector environment."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Native vector environments do not render."""
        return [None] * self.num_envs
