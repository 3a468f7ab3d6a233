#!/bin/sh
# ray[rllib] 2.60.0 with gymnasium 1.2.2 (which it pins), 2026-11-29.
# Expected: with gym_env_vectorize_mode="vector_entry_point", RLlib's episodes are those of the environment, or a vector
# whose metadata say SAME_STEP is refused.
# Seen: a SAME_STEP vector is taken, and each episode after the first lacks its first transition, while the last
# observation is the next episode's first. NEXT_STEP is right.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check torch==2.13.0
venv/bin/pip install --quiet --disable-pip-version-check "ray[rllib]==2.60.0" gymnasium==1.2.2
cat > look.py <<'P'
import sys

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner


class Counter(gym.Env):
    """Observes (episode, step); an episode has three steps."""

    observation_space = gym.spaces.Box(0, 100, (2,), np.float32)
    action_space = gym.spaces.Discrete(2)
    episode = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.episode, self.steps = self.episode + 1, 0
        return np.array([self.episode, 0], np.float32), {}

    def step(self, action):
        self.steps += 1
        return np.array([self.episode, self.steps], np.float32), 1.0, False, self.steps >= 3, {}


def episodes(mode):
    env_id = mode.value + "-v0"

    def vector(num_envs=1, **_):
        return SyncVectorEnv([Counter] * num_envs, autoreset_mode=mode)

    gym.register(env_id, entry_point=Counter, vector_entry_point=vector)
    config = PPOConfig().environment(env_id)
    one = {"num_env_runners": 0, "num_envs_per_env_runner": 1}
    config = config.env_runners(**one, gym_env_vectorize_mode="vector_entry_point")
    runner = SingleAgentEnvRunner(config=config, worker_index=1)
    done = [e for e in runner.sample(num_timesteps=20, random_actions=True) if e.is_done][:3]
    return [[tuple(int(x) for x in o) for o in e.get_observations()] for e in done]


right = [[(episode, step) for step in range(4)] for episode in (1, 2, 3)]
seen = {mode: episodes(mode) for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)}
for mode, observations in seen.items():
    print(mode.value, "(episode, step):", *observations, sep="\n  ")
if seen[AutoresetMode.NEXT_STEP] != right or seen[AutoresetMode.SAME_STEP][1] != [(2, 1), (2, 2), (3, 0)]:
    sys.exit("CHANGED")
P
RAY_USAGE_STATS_ENABLED=0 venv/bin/python -W ignore look.py 2>messages
