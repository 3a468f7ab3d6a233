"""Compile ahead of use: for container images, clusters, and machines without a writable home."""

from collections.abc import Callable, Iterable
from importlib.util import find_spec
from typing import Any

import gymnasium as gym
import numpy as np

from tensegrity_envs.env import unwrapped
from tensegrity_envs.registration import ENV_IDS


def compile_all(ids: Iterable[str] | None = None, progress: Callable[[str], None] = print) -> None:
    """Compile everything that environments need, and keep it in the cache (see `TENSEGRITY_CACHE_DIR`).

    Args:
        ids: of the environments; by default all, without MuJoCo those that do not need it.
        progress: is told what comes next.

    Raises:
        ValueError: there is no environment of some id.
    """
    if ids is None:
        ids = ENV_IDS
        if find_spec("mujoco") is None:
            ids = [env_id for env_id in ENV_IDS if gym.spec(env_id).kwargs.get("backend") != "mujoco"]
            progress("without MuJoCo (the extra mujoco), dynamic environments are left out")
    wanted = list(ids)
    unknown = [env_id for env_id in wanted if env_id not in gym.registry]
    if unknown:
        raise ValueError(f"ids: there is no {unknown[0]!r}; there are {', '.join(ENV_IDS)}")
    for k, env_id in enumerate(wanted, 1):
        progress(f"{k} of {len(wanted)}: {env_id}")
        for reward_type in ("dense", "sparse"):
            env = gym.make(env_id, reward_type=reward_type)
            observation, info = env.reset(seed=0)
            env.step(np.zeros(env.action_space.shape, np.float32))
            unwrapped(env).compute_reward(observation["achieved_goal"], observation["desired_goal"], info)
            env.close()
    if wanted:
        _compile_loops_of_vectors(wanted[0])


def _compile_loops_of_vectors(env_id: str) -> None:
    """What the vector shell adds, which is the same for all environments; see `columns`."""
    for mode in ("NextStep", "SameStep"):
        options: dict[str, Any] = {"max_episode_steps": 1, "autoreset_mode": mode}
        envs = gym.make_vec(env_id, 2, vectorization_mode="vector_entry_point", **options)
        envs.reset(seed=0)
        for kind in (np.float32, float):
            envs.step(np.zeros(envs.action_space.shape or (), kind))
        envs.close()
