"""A Gymnasium VectorEnv (SAME_STEP autoreset) as a Stable-Baselines3 VecEnv."""

from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvObs, VecEnvStepReturn

import tensegrity_envs  # noqa: F401  (registers the ids)


class VectorEnvAdapter(VecEnv):
    """Steps the whole batch with one call; SB3's own wrappers (VecMonitor, VecNormalize) go around it.

    The last observation of an episode is in info["terminal_observation"], and info["TimeLimit.truncated"] says that it
    ended by the time limit alone, so that SB3 bootstraps from its value. Other entries of `info` are handed on only in
    the step in which an episode ends: a list of full dicts for every step would cost more than the physics. Hindsight
    replay asks for them at every step: `full_info=True`, with `HerReplayBuffer(copy_info_dict=True)`.

    Args:
        envs: the vector environment.
        stagger: spread the time limits of the first episodes evenly (see the environment's `reset`).
        full_info: hand on `info` at every step.
        repeat_failed: with this probability, an episode that ended without success is begun again, not the next one.
            What is hard and rare, such as a start beside a joint limit, is then seen more often.

    Raises:
        ValueError: the environment does not reset in the same step.
    """

    def __init__(
        self,
        envs: VectorEnv[Any, Any, Any],
        stagger: bool = False,
        full_info: bool = False,
        repeat_failed: float = 0.0,
    ) -> None:
        mode = envs.metadata.get("autoreset_mode")
        if mode not in (AutoresetMode.SAME_STEP, AutoresetMode.SAME_STEP.value):
            raise ValueError(
                f"{envs}: resets in mode {getattr(mode, 'value', mode)!r}, and Stable-Baselines3 needs SAME_STEP: "
                'make it with autoreset_mode="SameStep", or by VectorEnvAdapter.make(id, num_envs)'
            )
        self.envs = envs
        self.shell: Any = envs.unwrapped  # the native vector environment
        self._stagger, self._full_info, self._repeat_failed = stagger, full_info, repeat_failed
        self._actions: np.ndarray
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    @classmethod
    def make(
        cls,
        env_id: str,
        num_envs: int,
        stagger: bool = False,
        full_info: bool = False,
        repeat_failed: float = 0.0,
        **options: Any,
    ) -> "VectorEnvAdapter":
        """Make the native vector of an id, in the right autoreset mode, and adapt it.

        Args:
            env_id: Gymnasium id.
            num_envs: number of environments.
            stagger: see the class.
            full_info: see the class.
            repeat_failed: see the class.
            **options: of `gym.make_vec`.
        """
        envs = gym.make_vec(
            env_id, num_envs, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options
        )
        return cls(envs, stagger, full_info, repeat_failed)

    def reset(self) -> VecEnvObs:
        """Begin new episodes everywhere, with the seeds given to `seed` if there were any."""
        seeds: Any = None if all(seed is None for seed in self._seeds) else list(self._seeds)
        observation, info = self.envs.reset(seed=seeds, options={"stagger": True} if self._stagger else None)
        if self._full_info:
            self.reset_infos = _each(info, range(self.num_envs))
        self._reset_seeds()
        self._reset_options()
        begun: VecEnvObs = observation
        return begun

    def step_async(self, actions: np.ndarray) -> None:
        """Remember the actions, shape (environments, action size)."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Take the step."""
        observation, reward, terminated, truncated, info = self.envs.step(self._actions)
        done = terminated | truncated
        infos = _each(info, range(self.num_envs)) if self._full_info else [{} for _ in range(self.num_envs)]
        ended = np.flatnonzero(done)
        if len(ended):
            for i, last in zip(ended, _each(info["final_info"], ended), strict=True):
                infos[i] = last
                infos[i]["terminal_observation"] = info["final_obs"][i]
                infos[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
            if self._repeat_failed:
                failed = ended[[not infos[i]["is_success"] for i in ended]]
                again = failed[np.random.random(len(failed)) < self._repeat_failed]  # noqa: NPY002
                if len(again):
                    observation = self._begun_again(again)
        return observation, reward.astype(np.float32), done, infos

    def _begun_again(self, index: np.ndarray) -> dict[str, np.ndarray]:
        """Begin the episodes that have just ended in the environments at `index` once more; the observations of all."""
        again = np.zeros(self.num_envs, bool)
        again[index] = True
        episode = np.where(again, self.shell.episode_numbers - 1, 0)  # the next ones are running already
        observation: dict[str, np.ndarray]
        observation, _ = self.envs.reset(options={"reset_mask": again, "episode": episode})
        return observation

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The attribute of the vector environment, once for every index."""
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def has_attr(self, attr_name: str) -> bool:
        """Whether the vector environment has the attribute."""
        return hasattr(self.envs, attr_name)

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the vector environment, for all environments at once."""
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Call a method of the vector environment once; its result stands for every index."""
        result = getattr(self.shell, method_name)(*args, **kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """No Gymnasium wrappers are inside a native vector environment."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """The pictures of all environments, made with render_mode="rgb_array"."""
        pictures: Any = self.envs.render()
        return [None] * self.num_envs if pictures is None else list(pictures)


def _each(info: dict[str, Any], index: Iterable[int]) -> list[dict[str, Any]]:
    """The infos of the environments at `index`, as one dict each."""
    names = [name for name in info if not name.startswith(("_", "final_"))]
    return [{name: info[name][i] for name in names} for i in index]
