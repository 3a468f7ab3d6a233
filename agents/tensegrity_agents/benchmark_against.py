"""Speeds of this build against those of another checkout, interleaved in one run, in CPU seconds.

Each build runs in a process of its own, which takes blocks of steps interleaved with the other's: what else the machine
does meanwhile slows down both. Seeds and actions are the same, time limits are staggered, episodes are begun anew in
the step in which they end, info is full.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple, cast

import numpy as np

from tensegrity_agents.config import ConfigError
from tensegrity_envs import ENV_IDS

# What both processes run, on whatever they find as `tensegrity_envs`.
_WORKER = """
import inspect, json, sys, time
import gymnasium as gym
import numpy as np
import tensegrity_envs
from tensegrity_envs.vector_env import ManipulatorVectorEnv

modes = "autoreset_mode" in inspect.signature(ManipulatorVectorEnv.__init__).parameters
envs = {}


def make(env_id, count):
    if count:
        options = {"autoreset_mode": "SameStep"} if modes else {}
        env = gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", **options)
        env.reset(seed=0, options={"stagger": True})
    else:
        env = gym.make(env_id)
        env.reset(seed=0)
    return env, np.random.default_rng(0)


def block(env_id, count, steps, size):
    if (env_id, count) not in envs:
        envs[env_id, count] = make(env_id, count)
    env, rng = envs[env_id, count]
    actions = rng.uniform(-size, size, (steps, *env.action_space.shape)).astype(np.float32)
    resets = 0.0
    begun = time.process_time()
    if count:
        for action in actions:
            env.step(action)
    else:
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                before = time.process_time()
                env.reset()
                resets += time.process_time() - before
    total = time.process_time() - begun
    return [total / steps, (total - resets) / steps]


for line in sys.stdin:
    asked = json.loads(line)
    if asked is None:
        print("told", json.dumps(tensegrity_envs.ENV_IDS), flush=True)
    elif asked["steps"]:
        print("told", json.dumps(block(**asked)), flush=True)
    else:
        del envs[asked["env_id"], asked["count"]]
        print("told []", flush=True)
"""
_ENDS_AT_ONCE = {"tensegrity/DualTrianglePush-v0": 0.05}  # under actions of full size, within a step or two
_MOVED_AT_ONCE = 16  # environments of a dynamic simulation, each of which costs as much as if it were alone


class Comparison(NamedTuple):
    """One line of the benchmark.

    Attributes:
        what: measured.
        ours: CPU seconds for each step of one environment.
        theirs: the same of the other checkout.
    """

    what: str
    ours: float
    theirs: float

    @property
    def ratio(self) -> float:
        """How many times as fast as the other checkout this build is."""
        return self.theirs / self.ours


class _Build:
    """A process that steps environments of some checkout."""

    def __init__(self, packages: Path) -> None:
        paths = os.pathsep.join([str(packages), *filter(None, [os.environ.get("PYTHONPATH")])])
        settings = os.environ | {"PYTHONPATH": paths, "OMP_NUM_THREADS": "1", "TENSEGRITY_QUIET": "1"}
        command = [sys.executable, "-W", "ignore", "-c", _WORKER]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=settings
        )

    def ask(self, **what: Any) -> Any:
        """The answer to one question; to none, the ids that there are."""
        cast(IO[str], self._process.stdin).write(json.dumps(what or None) + "\n")
        cast(IO[str], self._process.stdin).flush()
        for line in cast(IO[str], self._process.stdout):
            if line.startswith("told "):
                return json.loads(line.removeprefix("told "))
        raise ConfigError(f"the other checkout's environments do not run ({what})")

    def close(self) -> None:
        """End the process."""
        cast(IO[str], self._process.stdin).close()
        self._process.wait()


def against(
    checkout: Path,
    ids: Sequence[str] = ENV_IDS,
    counts: Sequence[int] = (1024, 64, 0),
    rounds: int = 15,
    progress: Callable[[str], None] = print,
) -> list[Comparison]:
    """Both builds on the same environments and actions; medians over interleaved blocks.

    Args:
        checkout: of the other build, with a folder `envs`.
        ids: of the environments.
        counts: environments of each vector, at most 16 of a dynamic simulation; 0 for a single one through `gym.make`.
        rounds: blocks of each build.
        progress: is told what is measured.

    Raises:
        ConfigError: there is no such checkout, or its environments do not run.
    """
    if not (checkout / "envs" / "tensegrity_envs").is_dir():
        raise ConfigError(f"--against {checkout}: must be a checkout, with a folder envs/tensegrity_envs")
    import tensegrity_envs

    builds = [_Build(Path(tensegrity_envs.__file__).parents[1]), _Build(checkout.resolve() / "envs")]
    lines = []
    try:
        known = builds[1].ask()
        for env_id in ids:
            if env_id not in known:
                progress(f"{env_id}: the other checkout does not have it")
                continue
            moving = "MuJoCo" in env_id
            for count in dict.fromkeys(min(count, _MOVED_AT_ONCE) if moving else count for count in counts):
                progress(f"{env_id} x {count or 1}, {rounds} blocks of either build")
                lines += _compare(builds, env_id, count, rounds)
    finally:
        for build in builds:
            build.close()
    return lines


def _compare(builds: list[_Build], env_id: str, count: int, rounds: int) -> list[Comparison]:
    # So many that episodes, which are drawn for many environments at once, are drawn several times.
    steps = 60 if "MuJoCo" in env_id else 1000
    asked = {"env_id": env_id, "count": count, "size": _ENDS_AT_ONCE.get(env_id, 1.0)}
    for build in builds:
        build.ask(**asked, steps=steps)  # compiled code is loaded here
    taken = np.array([[build.ask(**asked, steps=steps) for build in builds] for _ in range(rounds)])
    for build in builds:
        build.ask(**asked, steps=0)
    (ours, _), (theirs, _) = np.median(taken, axis=0) / max(count, 1)
    if count:
        return [Comparison(f"vector {env_id} x {count}", float(ours), float(theirs))]
    (_, own), (_, other) = np.median(taken, axis=0)
    return [
        Comparison(f"single {env_id} step", float(own), float(other)),
        Comparison(f"single {env_id} step, resets included", float(ours), float(theirs)),
    ]
