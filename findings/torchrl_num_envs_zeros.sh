#!/bin/sh
# torchrl 0.14.1 with gymnasium 1.4.0 and torch 2.13.0, 2026-11-29.
# Expected: GymEnv("Pendulum-v1", num_envs=2) rolls out as GymEnv("Pendulum-v1") does: the last observation of an
# episode is that of a pendulum (cosine and sine on the unit circle).
# Seen: all last observations are zeros, so values bootstrapped from them are wrong. GymEnv makes an AsyncVectorEnv in
# Gymnasium's default mode NEXT_STEP, which GymWrapper refuses when it is given one ("must be one of SAME_STEP or
# DISABLED"), and its reader of last observations finds none.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check torch==2.13.0
venv/bin/pip install --quiet --disable-pip-version-check torchrl==0.14.1 gymnasium==1.4.0
cat > look.py <<'P'
import sys

import torch
from torchrl.envs import GymEnv


def last_observations(**options):
    torch.manual_seed(0)
    envs = GymEnv("Pendulum-v1", **options)
    envs.set_seed(0)
    steps = envs.rollout(450, break_when_any_done=False)["next"]
    envs.close()
    return steps["observation"][steps["done"].squeeze(-1)]


if __name__ == "__main__":
    one, two = last_observations(), last_observations(num_envs=2)
    print("one environment:", one.tolist())
    print("num_envs=2:", two.tolist())
    if not one.any() or two.any():
        sys.exit("CHANGED")
P
venv/bin/python look.py 2>messages
