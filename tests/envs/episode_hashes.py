"""A hash of the first observation of 1,000 episodes of every id: what must not change unless CHANGELOG says so.

    python tests/envs/episode_hashes.py [id ...]

Each line: id, hash of all observations as single-precision numbers, and their sum, which tells another episode from
another last digit.
"""

import hashlib
import sys

import gymnasium as gym
import numpy as np

import tensegrity_envs

COUNT = 1000


def first_observations(env_id: str) -> np.ndarray:
    """The first observations of the environments seeded 0 to 999, shape (1000, size)."""
    envs = gym.make_vec(env_id, COUNT, vectorization_mode="vector_entry_point")
    observation, _ = envs.reset(seed=0)
    envs.close()
    return np.concatenate([observation[key] for key in sorted(observation)], axis=1)


if __name__ == "__main__":
    for env_id in sys.argv[1:] or tensegrity_envs.ENV_IDS:
        seen = first_observations(env_id)
        digest = hashlib.sha256(np.ascontiguousarray(seen).tobytes()).hexdigest()[:16]
        print(f"{env_id:45} {digest} {seen.sum(dtype=float):.6f}", flush=True)
