"""Very many steps of every id with actions of full size: no NaN, nothing out of its space, flat memory.

    python tests/envs/stress.py [id ...] [--steps 1000000] [--envs 1000]

Each line: id, steps, episodes by why they ended, numbers that were not finite or outside their space, memory after a
tenth of the steps and at the end [MB]. Exit status 1 if there were any of the former.
"""

import argparse
import resource
import sys
from collections import Counter

import gymnasium as gym
import numpy as np

import tensegrity_envs
from tensegrity_envs.vector_env import step_info


def memory() -> float:
    """The most that this process has used so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def stress(env_id: str, steps: int, count: int, seed: int = 0) -> tuple[Counter[str], int, float, float]:
    """Run bang-bang actions that change at random times.

    Returns:
        Episodes by why they ended ("time limit" among them), numbers that are wrong, memory [MB] early and late.
    """
    envs = gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    rng = np.random.default_rng(seed)
    envs.reset(seed=seed)
    box = envs.single_observation_space
    ends: Counter[str] = Counter()
    wrong, early = 0, 0.0
    action = rng.choice([-1.0, 1.0], envs.action_space.shape)
    rounds = -(-steps // count)
    for k in range(rounds):
        turn = rng.random(action.shape) < 0.1
        action = np.where(turn, -action, action)
        observation, reward, terminated, truncated, info = envs.step(action)
        for key, space in box.spaces.items():
            inside = (observation[key] >= space.low) & (observation[key] <= space.high)  # NaN is not
            wrong += int((~inside).sum())
        last = step_info(info)
        wrong += sum(int((~np.isfinite(part)).sum()) for part in (reward, *last.values()))
        ended = terminated | truncated
        reasons = tensegrity_envs.termination_reason(last["failure"])[ended]
        ends.update(str(reason) or "time limit" for reason in reasons)
        if k == rounds // 10:
            early = memory()
    envs.close()
    return ends, wrong, early, memory()


def main() -> int:
    """Parse the command line, print a line for each id."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ids", nargs="*", default=tensegrity_envs.ENV_IDS)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--envs", type=int, default=1000)
    given = parser.parse_args()
    bad = 0
    for env_id in given.ids:
        ends, wrong, early, late = stress(env_id, given.steps, given.envs)
        bad += wrong
        told = ", ".join(f"{reason} {number}" for reason, number in ends.most_common())
        print(f"{env_id}: {given.steps} steps; {told}; wrong {wrong}; memory {early:.0f}, {late:.0f} MB", flush=True)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
