"""Speeds as ratios to Gymnasium's Reacher-v5, all measured in one run; absolute numbers depend on the machine."""

import cProfile
import os
import pstats
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv
from scipy.optimize import minimize
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

import tensegrity_envs
from tensegrity_agents.config import Experiment
from tensegrity_agents.sb3.features import GoalErrorExtractor
from tensegrity_agents.sb3.vec_env import VectorEnvAdapter
from tensegrity_envs.env import unwrapped
from tensegrity_envs.mechanics import DualTriangle

REFERENCE = "Reacher-v5"
MOVING = tuple(env_id for env_id in tensegrity_envs.ENV_IDS if "MuJoCo" in env_id)
RESTING = tuple(env_id for env_id in tensegrity_envs.ENV_IDS if env_id not in MOVING)
_PARTS = {
    ("batch", "step"): "physics and reward",
    ("episodes", "begin"): "new episodes",
    ("vector_env", "_observation"): "observations",
    ("vector_env", "_info"): "info",
}
_SINGLE_GOALS = {
    "tensegrity/TwoXReach-v0": 1.5,
    "tensegrity/TwoXTensionReach-v0": 1.0,
    **{f"tensegrity/DualTriangle{task}-v0": 0.7 for task in ("Reach", "LoadedReach", "Push")},
    "tensegrity/PlanarFourBarReach-v0": 1.0,
    "tensegrity/SpatialPrismTrack-v0": 1.0,
    "tensegrity/SpatialPrismPayloadTrack-v0": 0.3,
}
_VECTOR_GOALS = {
    "tensegrity/TwoXReach-v0": 80.0,
    "tensegrity/TwoXTensionReach-v0": 30.0,
    **{f"tensegrity/DualTriangle{task}-v0": 30.0 for task in ("Reach", "LoadedReach", "Push")},
    "tensegrity/PlanarFourBarReach-v0": 40.0,
    "tensegrity/SpatialPrismTrack-v0": 40.0,
    "tensegrity/SpatialPrismPayloadTrack-v0": 15.0,
}


_DYNAMIC_GOALS = {
    "tensegrity/TwoXTensionReachMuJoCo-v0": 0.5,
    **{f"tensegrity/DualTriangle{task}MuJoCo-v0": 0.7 for task in ("Reach", "LoadedReach")},
}
# Uniform random actions of full size end an episode of pushing within a step or two.
_GENTLE = ("tensegrity/DualTrianglePush-v0", 0.05)
_BLOCK = 124  # steps of a vector; episodes are drawn a dozen ahead for each of 1,024 environments


class Speed(NamedTuple):
    """One line of the benchmark.

    Attributes:
        what: measured.
        per_second: environment steps (or targets) per second.
        ratio: to the reference.
        goal: of the ratio; None where none is set.
    """

    what: str
    per_second: float
    ratio: float
    goal: float | None


def single(rounds: int = 5, steps: int = 2000, progress: Callable[[str], None] = print) -> list[Speed]:
    """Single environments through `gym.make`, uniform random actions, resets included; median over interleaved
    rounds.
    """
    ids = (REFERENCE, *RESTING)
    envs = {env_id: gym.make(env_id) for env_id in ids}
    taken: dict[str, list[float]] = {env_id: [] for env_id in ids}
    stepping: dict[str, list[float]] = {env_id: [] for env_id in ids}
    for env in envs.values():
        env.reset(seed=0)
        env.action_space.seed(0)
        if env.step(env.action_space.sample())[2]:  # compiled code is loaded here
            env.reset()
    for turn in range(rounds):
        for env_id, env in envs.items():
            progress(f"single {env_id}, round {turn + 1} of {rounds}")
            actions = [env.action_space.sample() for _ in range(steps)]
            env.reset()
            begun = time.perf_counter()
            resets = 0.0
            for action in actions:
                _, _, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    before = time.perf_counter()
                    env.reset()
                    resets += time.perf_counter() - before
            total = time.perf_counter() - begun
            taken[env_id].append(total / steps)
            stepping[env_id].append((total - resets) / steps)
    lines = []
    for times, what, wanted in ((stepping, "step", _SINGLE_GOALS), (taken, "step, resets included", {})):
        reference = float(np.median(times[REFERENCE]))
        for env_id in ids:
            own = float(np.median(times[env_id]))
            lines.append(Speed(f"single {env_id} {what}", 1 / own, reference / own, wanted.get(env_id)))
    return lines


def vector(count: int = 1024, blocks: int = 10, progress: Callable[[str], None] = print) -> list[Speed]:
    """Vector environments of `count`, uniform random actions, 124 steps in a block: resets and synchronized time limits
    included, in so many steps that the episodes that are drawn ahead are used, too.

    Each is measured interleaved with Reacher-v5, block by block, since a machine that others use, too, is not always as
    fast. Reacher's ten blocks of five steps are an episode.
    """
    rivals = gym.make_vec(REFERENCE, count, vectorization_mode="sync")
    rivals.reset(seed=0)
    lines: list[Speed] = []
    rival_rates = []
    for env_id, size in [*((env_id, 1.0) for env_id in RESTING), _GENTLE]:
        progress(f"vector {env_id} x {count}, {_BLOCK * blocks} steps, and {5 * blocks} of {REFERENCE}")
        envs = gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
        envs.reset(seed=0)
        rng = np.random.default_rng(0)
        _seconds(envs, rng, size, 1)  # compiled code is loaded here
        own, rival = np.sum(
            [(_seconds(envs, rng, size, _BLOCK) / _BLOCK, _seconds(rivals, rng, 1.0, 5) / 5) for _ in range(blocks)],
            axis=0,
        )
        envs.close()
        rival_rates.append(count * blocks / rival)
        what = f"vector {env_id} x {count}" + (f", actions of at most {size:g}" if size < 1 else "")
        lines.append(Speed(what, count * blocks / own, rival / own, _VECTOR_GOALS.get(env_id) if size == 1 else None))
    rivals.close()
    return [Speed(f"vector {REFERENCE} x {count}, sync", float(np.median(rival_rates)), 1.0, None), *lines]


def _seconds(envs: VectorEnv[Any, Any, Any], rng: np.random.Generator, size: float, steps: int) -> float:
    """That so many steps take."""
    actions = rng.uniform(-size, size, (steps, *(envs.action_space.shape or ()))).astype(np.float32)
    begun = time.perf_counter()
    for action in actions:
        envs.step(action)
    return time.perf_counter() - begun


def dynamics(
    rounds: int = 3, steps: int = 400, count: int = 512, progress: Callable[[str], None] = print
) -> list[Speed]:
    """Dynamic environments against Reacher-v5 of the same number of time steps in a step: single ones, and the vector's
    throughput for each core against that of the better of Gymnasium's sync (one core) and async vectors (all cores).
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    lines = []
    for env_id in MOVING:
        env = gym.make(env_id)
        core = unwrapped(env).core
        assert core.dynamics is not None
        skip = core.dynamics.frame_skip
        pair = {env_id: env, REFERENCE: gym.make(REFERENCE, frame_skip=skip)}
        taken: dict[str, list[float]] = {name: [] for name in pair}
        for turn in range(rounds):
            progress(f"single {env_id} and {REFERENCE}, {skip} time steps, round {turn + 1} of {rounds}")
            for name, one in pair.items():
                taken[name].append(_stepping(one, steps))
        own, reference = (float(np.median(taken[name])) for name in (env_id, REFERENCE))
        what = f"single {env_id} step, of {skip} time steps each"
        lines.append(Speed(what, 1 / own, reference / own, _DYNAMIC_GOALS.get(env_id)))
        rates = {}
        for mode, used in (("sync", 1), ("async", cores)):
            progress(f"{mode} vector of {REFERENCE}, {skip} time steps")
            vectors = gym.make_vec(REFERENCE, used if used > 1 else 16, vectorization_mode=mode, frame_skip=skip)
            rates[mode] = _vector_rate(vectors, 2 * steps if used > 1 else steps // 4) / used
        progress(f"vector {env_id} x {count}")
        ours = (
            _vector_rate(
                gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep"), 20
            )
            / cores
        )
        best = max(rates, key=lambda mode: rates[mode])
        what = f"vector {env_id} x {count}, for each core, against the {best} vector"
        lines.append(Speed(what, ours, ours / rates[best], None))
    return lines


def _stepping(env: gym.Env[Any, Any], steps: int) -> float:
    """Seconds for a step, resets aside, with uniform random actions of a third of the full size."""
    env.reset(seed=0)
    env.action_space.seed(0)
    total = 0.0
    for _ in range(steps):
        action = env.action_space.sample() / 3
        begun = time.perf_counter()
        _, _, terminated, truncated, _ = env.step(action)
        total += time.perf_counter() - begun
        if terminated or truncated:
            env.reset()
    return total / steps


def _vector_rate(envs: VectorEnv[Any, Any, Any], steps: int) -> float:
    """Environment steps per second, resets included, with uniform random actions of a third of the full size."""
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1 / 3, 1 / 3, (steps + 1, *(envs.action_space.shape or ()))).astype(np.float32)
    envs.reset(seed=0)
    envs.step(actions[0])
    begun = time.perf_counter()
    for action in actions[1:]:
        envs.step(action)
    rate = float(envs.num_envs * steps / (time.perf_counter() - begun))
    envs.close()
    return rate


def shares(env_id: str, count: int = 1024, steps: int = 100) -> dict[str, float]:
    """Where a vector step's time goes: shares of the profiled time."""
    envs = gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    profile = cProfile.Profile()
    for _ in range(steps):
        action = rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32)
        profile.runcall(envs.step, action)
    profiled: Any = pstats.Stats(profile)
    stats: dict[Any, Any] = profiled.stats
    spent = {name: 0.0 for name in _PARTS.values()}
    for (file, _, function), (_, _, _, cumulative, _) in stats.items():
        part = _PARTS.get((Path(file).stem, function))
        if part is not None and "tensegrity_envs" in file:
            spent[part] += cumulative
    total = next(c for (f, _, name), (_, _, _, c, _) in stats.items() if name == "step" and "vector_env" in f)
    spent["everything else"] = total - sum(spent.values())
    return {name: value / total for name, value in spent.items()}


def ppo(experiment: Experiment, timesteps: int = 120_000, progress: Callable[[str], None] = print) -> list[Speed]:
    """Frames per second of PPO, learning included: ours as configured, Reacher-v5 with SB3's defaults in the better of
    8 and 64 environments.
    """
    rates: dict[str, float] = {}
    for count, n_steps in ((8, 2048), (64, 256)):
        progress(f"PPO on {REFERENCE} x {count}")
        env = VecNormalize(VecMonitor(DummyVecEnv([lambda: gym.make(REFERENCE)] * count)))
        model = PPO("MlpPolicy", env, n_steps=n_steps, device="cpu", seed=0)
        rates[f"PPO {REFERENCE}, DummyVecEnv {count}"] = _frames(model, timesteps // 3)
    reference = max(rates.values())
    s = experiment.train.ppo
    progress(f"PPO on {experiment.env} x {s.num_envs}")
    envs = gym.make_vec(experiment.env, s.num_envs, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    env = VecNormalize(VecMonitor(VectorEnvAdapter(envs)), norm_obs_keys=["observation"], norm_reward=False)
    kwargs = {"net_arch": experiment.train.net_arch, "features_extractor_class": GoalErrorExtractor}
    model = PPO(
        "MultiInputPolicy",
        env,
        n_steps=s.n_steps,
        batch_size=s.batch_size,
        n_epochs=s.n_epochs,
        policy_kwargs=kwargs,
        device="cpu",
        seed=0,
    )
    ours = _frames(model, timesteps)
    lines = [Speed(name, rate, rate / reference, None) for name, rate in rates.items()]
    return [*lines, Speed(f"PPO {experiment.env} x {s.num_envs}", ours, ours / reference, 2.0)]


def redundancy(targets: int = 10_000, compared: int = 100, progress: Callable[[str], None] = print) -> list[Speed]:
    """Redundancy resolution of the dual-triangle arm, all three objectives for many targets, against scipy's `minimize`
    (SLSQP with the tip's position as a constraint, from the same start) on the first of them; in seconds of processor
    time, of one core.
    """
    arm, rng = DualTriangle(), np.random.default_rng(0)
    limit = float(arm.design.joint_limit)
    x, y = arm.tip(tuple(rng.uniform(-limit, limit, (3, targets))))
    start, optimizer = (-0.1, 0.1, 0.1), cast(Any, minimize)  # whose types know no such constraint
    lines = []
    for name in ("sum", "max", "squares"):
        progress(f"redundancy resolution by {name}, {targets} targets")
        begun = time.process_time()
        arm.redundancy(x, y, start, name)
        rate = targets / (time.process_time() - begun)
        costs: Any = {
            "sum": lambda q: np.abs(q - start).sum(),
            "max": lambda q: np.abs(q - start).max(),
            "squares": lambda q: ((q - start) ** 2).sum(),
        }
        begun = time.process_time()
        for i in range(compared):
            place: Any = {"type": "eq", "fun": lambda q, i=i: np.subtract(arm.tip(q), (x[i], y[i]))}
            optimizer(costs[name], start, method="SLSQP", bounds=[(-limit, limit)] * 3, constraints=[place])
        scipy_rate = compared / (time.process_time() - begun)
        what = f"redundancy by {name}, targets in a CPU second (ratio to scipy's minimize)"
        lines.append(Speed(what, rate, rate / scipy_rate, 50.0))
    return lines


class Start(NamedTuple):
    """CPU seconds of a process that imports the package, makes an environment, resets it and steps once.

    Attributes:
        what: started.
        cold: with an empty cache of machine code.
        warm: with a filled one.
        kilobytes: of machine code in the cache.
    """

    what: str
    cold: float
    warm: float
    kilobytes: float


def compiling(ids: Sequence[str] = tensegrity_envs.ENV_IDS, progress: Callable[[str], None] = print) -> list[Start]:
    """What the first and the second use of environments cost, in a process of its own each; last, of all in one."""
    lines = []
    for what, started in (*((env_id, [env_id]) for env_id in ids), (f"all {len(ids)}", ids)):
        progress(f"starting {what}, twice")
        with tempfile.TemporaryDirectory() as folder:
            cold, warm = _start(started, folder), _start(started, folder)
            size = sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file())
        lines.append(Start(what, cold, warm, size / 1000))
    return lines


_START = """
import sys, time, gymnasium, tensegrity_envs
for env_id in sys.argv[1:]:
    env = gymnasium.make(env_id)
    env.reset(seed=0)
    env.step(env.action_space.sample())
print(time.process_time())
"""


def _start(ids: Sequence[str], folder: str) -> float:
    settings = os.environ | {"TENSEGRITY_CACHE_DIR": folder, "TENSEGRITY_QUIET": "1"}
    command = [sys.executable, "-W", "ignore", "-c", _START, *ids]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=settings)
    return float(done.stdout.split()[-1])


def _frames(model: PPO, timesteps: int) -> float:
    model.learn(model.n_steps * model.n_envs)  # warm up
    before = model.num_timesteps
    begun = time.perf_counter()
    model.learn(timesteps, reset_num_timesteps=False)
    return float((model.num_timesteps - before) / (time.perf_counter() - begun))
