#!/bin/sh
# gymnasium 1.4.0 with numpy 2.4.6, 2026-11-29.
# Expected: SyncVectorEnv collects an info entry that each environment gives as np.bool_ into an array of dtype bool, as
# it collects bool, np.float64 and np.int64 into arrays of their dtypes.
# Seen: the array has dtype object, with None where an environment has not told the entry, since np.bool_ is no np.number;
# clients that make tensors of infos fail on it. An array of shape () and dtype bool is collected into dtype bool.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check gymnasium==1.4.0 numpy==2.4.6
venv/bin/python - <<'P'
import sys

import gymnasium as gym
import numpy as np


class Tells(gym.Wrapper):
    def step(self, action):
        observation, reward, terminated, truncated, info = self.env.step(action)
        told = {"python": True, "numpy": np.bool_(True), "array": np.array(True), "float": np.float64(1)}
        return observation, reward, terminated, truncated, info | told


envs = gym.vector.SyncVectorEnv([lambda: Tells(gym.make("CartPole-v1"))] * 2)
envs.reset(seed=0)
info = envs.step(envs.action_space.sample())[4]
kinds = {name: str(info[name].dtype) for name in ("python", "numpy", "array", "float")}
print(kinds)
if kinds != {"python": "bool", "numpy": "object", "array": "bool", "float": "float64"}:
    sys.exit("CHANGED")
P
