#!/bin/sh
# gymnasium 1.4.0, 2026-11-30.
# Expected: a first reset that is refused (a negative seed) leaves an environment as it was; the next reset, which is
# valid, begins an episode, and its steps are taken.
# Seen: that reset begins an episode, but every step raises TypeError ("cannot unpack non-iterable NoneType object"),
# after the environment has taken it. The checker that gym.make puts around every environment compares the data of the
# first step with those of its first reset, and counts the refused one as the first.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check gymnasium==1.4.0 numpy==2.4.6
venv/bin/python - <<'P'
import sys

import gymnasium as gym


def steps_after(seeds, **options):
    env = gym.make("CartPole-v1", **options)
    for seed in seeds:
        try:
            env.reset(seed=seed)
        except gym.error.Error:
            pass
    seen = []
    for _ in range(3):
        try:
            env.step(0)
            seen.append("taken")
        except TypeError:
            seen.append("TypeError")
    return seen


found = {
    "valid reset": steps_after([0]),
    "refused, then valid": steps_after([-1, 0]),
    "the same without the checker": steps_after([-1, 0], disable_env_checker=True),
}
for name, seen in found.items():
    print(name, seen)
if list(found.values()) != [["taken"] * 3, ["TypeError"] * 3, ["taken"] * 3]:
    sys.exit("CHANGED")
P
