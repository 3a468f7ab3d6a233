"""Training at several levels of uncertainty at once, which the agent is not told."""

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvObs, VecEnvStepReturn

from tensegrity_agents.sb3.vec_env import VectorEnvAdapter


class LevelsVecEnv(VecEnv):
    """Vector environments of one id at different levels, side by side as one.

    Every environment keeps its level, and every level has as many environments as the others (to within one): of any
    batch of steps an equal share is at each, as if every episode drew its level.

    Args:
        parts: the vector environments.

    Raises:
        ValueError: observations or actions differ between them.
    """

    def __init__(self, parts: Sequence[VectorEnvAdapter]) -> None:
        self.parts = list(parts)
        first = self.parts[0]
        for part in self.parts:
            if (part.observation_space, part.action_space) != (first.observation_space, first.action_space):
                raise ValueError(f"levels: {part.observation_space} and {first.observation_space} cannot be mixed")
        self.ends = np.cumsum([part.num_envs for part in self.parts])
        self.shell = Shells([part.shell for part in self.parts])
        super().__init__(int(self.ends[-1]), first.observation_space, first.action_space)

    @classmethod
    def make(cls, env_id: str, num_envs: int, levels: Sequence[int], **options: Any) -> "LevelsVecEnv":
        """Make the native vectors of an id.

        Args:
            env_id: Gymnasium id.
            num_envs: number of environments in all.
            levels: of uncertainty, see `tensegrity_envs.uncertainty`.
            **options: of `VectorEnvAdapter.make`.
        """
        counts = [len(part) for part in np.array_split(np.arange(num_envs), len(levels))]
        return cls(
            [
                VectorEnvAdapter.make(env_id, count, **options | {"level": level})
                for count, level in zip(counts, levels, strict=True)
            ]
        )

    def _split(self, values: Any) -> list[Any]:
        return [values[end - part.num_envs : end] for part, end in zip(self.parts, self.ends, strict=True)]

    def reset(self) -> VecEnvObs:
        """Begin new episodes everywhere, with the seeds given to `seed` if there were any."""
        for part, seeds in zip(self.parts, self._split(self._seeds), strict=True):
            part._seeds = seeds
        told = _joined([part.reset() for part in self.parts])
        self._reset_seeds()
        self._reset_options()
        return told

    def step_async(self, actions: np.ndarray) -> None:
        """Remember the actions, shape (environments, action size)."""
        for part, own in zip(self.parts, self._split(actions), strict=True):
            part.step_async(own)

    def step_wait(self) -> VecEnvStepReturn:
        """Take the step."""
        observations, rewards, dones, infos = zip(*(part.step_wait() for part in self.parts), strict=True)
        return (
            _joined(observations),
            np.concatenate(rewards),
            np.concatenate(dones),
            [info for part in infos for info in part],
        )

    def close(self) -> None:
        """Close the environments."""
        for part in self.parts:
            part.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The attribute of the vector environment that each index is in."""
        each = [value for part in self.parts for value in part.get_attr(attr_name)]
        return [each[i] for i in self._get_indices(indices)]

    def has_attr(self, attr_name: str) -> bool:
        """Whether the vector environments have the attribute."""
        return all(part.has_attr(attr_name) for part in self.parts)

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the vector environments, for all environments at once."""
        for part in self.parts:
            part.set_attr(attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Call a method of each vector environment once; its result stands for every index in it."""
        each = [value for part in self.parts for value in part.env_method(method_name, *args, **kwargs)]
        return [each[i] for i in self._get_indices(indices)]

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """No Gymnasium wrappers are inside native vector environments."""
        return [False for _ in self._get_indices(indices)]


class Shells:
    """The native vector environments within, as far as checkpoints and teachers ask for them.

    Args:
        parts: one for each level.
    """

    def __init__(self, parts: list[Any]) -> None:
        self.parts = parts

    def get_state(self) -> list[Any]:
        """The states of all."""
        return [part.get_state() for part in self.parts]

    def set_state(self, states: list[Any]) -> None:
        """Go on where `get_state` was taken."""
        for part, state in zip(self.parts, states, strict=True):
            part.set_state(state)


def _joined(observations: Sequence[Any]) -> dict[str, np.ndarray]:
    return {key: np.concatenate([one[key] for one in observations]) for key in observations[0]}
