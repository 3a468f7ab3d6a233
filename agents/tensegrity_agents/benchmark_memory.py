"""Peak memory of processes that reset and step for long: it should be flat over time. On Linux alone."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from tensegrity_agents.config import ConfigError

RESETS, COUNT, STEPS = 10_000, 4096, 1000
_WORKER = """
import os, sys
import gymnasium as gym
import numpy as np
import tensegrity_envs

env_id, count, times = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])


def used():
    with open("/proc/self/statm") as file:  # the peak that the system tells is inherited from the parent process
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


before, peak, told = used(), 0, []
if count:
    envs = gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    envs.reset(seed=0, options={"stagger": True})
    rng = np.random.default_rng(0)
else:
    env = gym.make(env_id)
for k in range(times):
    if count:
        envs.step(rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32))
    else:
        env.reset(seed=k if k % 2 else None)
    peak = max(peak, used())
    if k + 1 in (times // 5, times):
        told.append(peak)
print(before, *told)
"""


class Memory(NamedTuple):
    """Peaks of one process's memory [MB].

    Attributes:
        what: it did.
        imported: before it made an environment.
        fifth: after a fifth of its work.
        whole: after all of it.
    """

    what: str
    imported: float
    fifth: float
    whole: float


def memory(env_id: str = "tensegrity/TwoXReach-v0", progress: Callable[[str], None] = print) -> list[Memory]:
    """Of 10,000 resets of a single environment, every other one seeded, and of a vector of 4,096 over 1,000 steps.

    Raises:
        ConfigError: this system does not tell how much memory a process uses.
    """
    if not Path("/proc/self/statm").exists():
        raise ConfigError("memory is measured on Linux alone")
    lines = []
    for count, times, what in (
        (0, RESETS, f"{RESETS:,} resets of {env_id}"),
        (COUNT, STEPS, f"{STEPS:,} steps of {env_id} x {COUNT:,}"),
    ):
        progress(what)
        command = [sys.executable, "-W", "ignore", "-c", _WORKER, env_id, str(count), str(times)]
        settings = os.environ | {"TENSEGRITY_QUIET": "1"}
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=settings)
        lines.append(Memory(what, *(int(number) / 1e6 for number in done.stdout.split())))
    return lines
