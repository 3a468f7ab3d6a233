"""A hash of what every baseline does on every id: what must not change while code moves.

    python tests/agents/behaviour_hashes.py [id ...]

Each line: id, baseline, hash of all numbers of a short run (observations, rewards, flags and info of each step), and
the sum of their magnitudes, which tells another behaviour from another last digit.
"""

import hashlib
import sys
from typing import Any

import gymnasium as gym
import numpy as np

import tensegrity_envs
from tensegrity_agents.controllers import baselines_of, make_controller

COUNT, STEPS, SEED = 6, 30, 11


def numbers_of(seen: Any) -> list[np.ndarray]:
    """All numbers in nested dicts, in the order of their keys."""
    if isinstance(seen, dict):
        return [array for key in sorted(seen) for array in numbers_of(seen[key])]
    if isinstance(seen, np.ndarray) and seen.dtype == object:
        return [array for one in seen if one is not None for array in numbers_of(one)]
    return [np.asarray(seen, float).ravel()]


def run(env_id: str, name: str) -> np.ndarray:
    """All numbers of a short run of a baseline."""
    envs = gym.make_vec(env_id, COUNT, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    shell: Any = envs.unwrapped
    controller = make_controller(name, env_id)
    observation, info = envs.reset(seed=SEED)
    begin = getattr(controller, "begin_episodes", None)
    told = numbers_of(observation) + numbers_of(info)
    state, start = None, np.ones(COUNT, bool)
    for _ in range(STEPS):
        if begin is not None and start.any():
            begin(start, shell.design, shell.episode if getattr(controller, "wants_privileged", False) else None)
        actions, state = controller.predict(observation, state=state, episode_start=start, deterministic=True)
        observation, reward, terminated, truncated, info = envs.step(actions)
        start = terminated | truncated
        told += [*numbers_of(observation), reward, terminated, truncated, *numbers_of(info)]
    envs.close()
    return np.concatenate([np.asarray(part, float).ravel() for part in told])


if __name__ == "__main__":
    for env_id in sys.argv[1:] or tensegrity_envs.ENV_IDS:
        for name in baselines_of(env_id):
            numbers = run(env_id, name)
            digest = hashlib.sha256(numbers.tobytes()).hexdigest()[:16]
            print(f"{env_id:45} {name:20} {digest} {np.nansum(np.abs(numbers)):.9g}", flush=True)
