#!/bin/sh
# torchrl 0.14.1 with gymnasium 1.4.0 and torch 2.13.0, 2026-11-29.
# Expected: GymWrapper of a vector in SAME_STEP, one of the two modes that it accepts, rolls out where observations are a
# Dict, as it does where they are a Box.
# Seen: at the first end of an episode RuntimeError: generator raised StopIteration (terminal_obs_reader enumerates the
# dict of last observations, which became a TensorDict without batch). DISABLED works.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check torch==2.13.0
venv/bin/pip install --quiet --disable-pip-version-check torchrl==0.14.1 gymnasium==1.4.0
venv/bin/python - <<'P' 2>messages
import sys

import gymnasium as gym
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TransformObservation
from torchrl.envs import GymWrapper


def dicts():
    env = gym.make("CartPole-v1")
    space = gym.spaces.Dict({"state": env.observation_space})
    return TransformObservation(env, lambda o: {"state": o}, space)


def rollout(make, mode):
    envs = GymWrapper(SyncVectorEnv([make] * 2, autoreset_mode=mode))
    try:
        return f"{envs.rollout(100, break_when_any_done=False)['next', 'done'].sum()} episodes ended"
    except RuntimeError as fault:
        return f"RuntimeError: {fault}"


seen = [
    rollout(lambda: gym.make("CartPole-v1"), AutoresetMode.SAME_STEP),
    rollout(dicts, AutoresetMode.DISABLED),
    rollout(dicts, AutoresetMode.SAME_STEP),
]
print(f"Box, SAME_STEP: {seen[0]}\nDict, DISABLED: {seen[1]}\nDict, SAME_STEP: {seen[2]}")
if "ended" not in seen[0] or "ended" not in seen[1] or "StopIteration" not in seen[2]:
    sys.exit("CHANGED")
P
