"""Training in segments: after each one everything that the next needs is on disk, and a killed run goes on from there.

A segment begins with freshly reset environments and reseeded random numbers, both functions of (seed, segment) alone.
For PPO a resumed run therefore repeats exactly what an uninterrupted one would have done (same machine, same number of
threads). SAC and TQC also need their replay buffer, which is not kept: after a resume it fills anew before learning
goes on, so their results differ from an uninterrupted run, though not in kind.
"""

import csv
import os
import random
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from sb3_contrib import TQC
from stable_baselines3 import PPO, SAC, HerReplayBuffer
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

from tensegrity_agents.config import Experiment, TrainConfig
from tensegrity_agents.sb3.hints import HintedVecEnv, Hints
from tensegrity_agents.sb3.policy_file import Normalization, TrainedPolicy, policy_kwargs, save_policy
from tensegrity_agents.sb3.vec_env import VectorEnvAdapter

CHECKPOINT, CURVE = "checkpoint.pt", "progress.csv"
CURVE_COLUMNS = ("seconds", "timesteps", "success", "return", "length")
# progress(timesteps, total, success share of the latest episodes)
Progress = Callable[[int, int, float], None]


class TrainingError(RuntimeError):
    """Training cannot go on; the message says what to do."""


class _Report(BaseCallback):
    """Hands progress on, and keeps the learning curve."""

    def __init__(
        self, total: int, rows: list[list[float]], begun: float, progress: Progress | None, interval: float
    ) -> None:
        super().__init__()
        self.total, self.rows, self.begun, self.progress, self.interval = total, rows, begun, progress, interval
        self._last = 0.0

    def _on_step(self) -> bool:
        now = time.monotonic()
        if now - self._last < self.interval:
            return True
        self._last = now
        episodes, successes = self.model.ep_info_buffer, self.model.ep_success_buffer
        success = float(np.mean(successes)) if successes else float("nan")
        if episodes:
            mean_return, length = (float(np.mean([e[key] for e in episodes])) for key in ("r", "l"))
            self.rows.append([now - self.begun, float(self.num_timesteps), success, mean_return, length])
        if self.progress is not None:
            self.progress(min(self.num_timesteps, self.total), self.total, success)
        return True


def train(
    experiment: Experiment, seed: int, folder: Path, progress: Progress | None = None, resume: bool = True
) -> TrainedPolicy:
    """Train one agent, or go on with it, and save its policy in `folder`.

    Args:
        experiment: environment and settings.
        seed: of this agent; environments, networks and exploration all follow from it.
        folder: gets checkpoint.pt, progress.csv, tensorboard/, and in the end policy.safetensors and policy.json.
        progress: called a few times a second.
        resume: go on from the checkpoint in the folder if there is one.

    Raises:
        TrainingError: the checkpoint there is of another experiment or cannot be read.
    """
    settings = experiment.train
    folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(settings.threads)
    env = _environment(experiment)
    model = _model(experiment, env, seed)
    described = {"env": experiment.env, "seed": seed, **settings.model_dump(mode="json")}
    rows: list[list[float]] = []
    seconds, segment = 0.0, 0
    checkpoint = folder / CHECKPOINT
    if resume and checkpoint.is_file():
        seconds, segment, rows = _restore(checkpoint, described, model, env)
    begun = time.monotonic() - seconds
    model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
    total = settings.total_timesteps
    # SB3 tells a schedule the progress within one call of learn(); ours is over the whole training.
    rate = (settings.ppo if settings.algorithm == "ppo" else settings.off_policy).learning_rate
    model.lr_schedule = lambda _: rate * max(1.0 - model.num_timesteps / total, 0.0)
    while model.num_timesteps < total:
        _reseed(model, env, seed, segment)
        report = _Report(total, rows, begun, progress, 1.0 if settings.algorithm == "ppo" else 5.0)
        amount = min(settings.segment_timesteps, total - model.num_timesteps)
        model.learn(amount, callback=report, reset_num_timesteps=False, log_interval=10)
        segment += 1
        _write_curve(folder / CURVE, rows)
        _keep(checkpoint, described, model, env, time.monotonic() - begun, segment, rows)
    if progress is not None:
        progress(total, total, rows[-1][2] if rows else float("nan"))
    normalization = Normalization.of(env)
    description = {
        "env": experiment.env,
        "algorithm": settings.algorithm,
        "net_arch": settings.net_arch,
        "activation": settings.activation,
        "goal_error_scales": settings.goal_error_scales,
        "goal_is_angles": settings.goal_is_angles,
        "goal_scale": settings.goal_scale,
        "model_hints": settings.model_hints,
        "seed": seed,
        "timesteps": model.num_timesteps,
        "training_seconds": round(time.monotonic() - begun, 1),
        "train": settings.model_dump(mode="json"),
    }
    save_policy(folder, model.policy, normalization, description)
    env.close()
    model.policy.set_training_mode(False)
    return TrainedPolicy(model.policy, normalization, description)


def with_later_settings(before: dict[str, Any], described: dict[str, Any]) -> dict[str, Any]:
    """Settings as they were recorded, completed by those that came later, which had their default then."""
    later = {
        key: field.get_default(call_default_factory=True)
        for key, field in TrainConfig.model_fields.items()
        if not field.is_required()
    }
    return {key: later[key] for key in described if key in later} | before


def read_curve(path: Path) -> dict[str, np.ndarray]:
    """The learning curve that `train` wrote: arrays by column, empty if there is none."""
    if not path.is_file():
        return {name: np.zeros(0) for name in CURVE_COLUMNS}
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in CURVE_COLUMNS}


def _environment(experiment: Experiment) -> VecNormalize:
    settings = experiment.train
    if settings.algorithm == "ppo":
        inner: Any = VectorEnvAdapter.make(experiment.env, settings.ppo.num_envs, stagger=True, **settings.env_options)
    else:
        inner = DummyVecEnv([lambda: gym.make(experiment.env, **settings.env_options)])
    if settings.model_hints:
        inner = HintedVecEnv(inner, Hints(experiment.env))
    return VecNormalize(VecMonitor(inner), norm_obs_keys=["observation"], norm_reward=False)


def _model(experiment: Experiment, env: VecNormalize, seed: int) -> BaseAlgorithm:
    s = experiment.train
    kwargs = policy_kwargs(s.algorithm, s.net_arch, s.activation, s.goal_error_scales, s.goal_is_angles, s.goal_scale)
    if s.algorithm == "ppo":
        p = s.ppo
        rollout = p.n_steps * p.num_envs
        return PPO(
            "MultiInputPolicy",
            env,
            n_steps=p.n_steps,
            batch_size=min(p.batch_size, rollout),
            n_epochs=p.n_epochs,
            gamma=p.gamma,
            gae_lambda=p.gae_lambda,
            learning_rate=p.learning_rate,
            clip_range=p.clip_range,
            ent_coef=p.ent_coef,
            policy_kwargs=kwargs | {"log_std_init": p.log_std_init},
            seed=seed,
            device="cpu",
        )
    o = s.off_policy
    algorithm: Any = {"sac": SAC, "tqc": TQC}[s.algorithm]
    her: dict[str, Any] = {}
    if o.her:
        her = {
            "replay_buffer_class": HerReplayBuffer,
            "replay_buffer_kwargs": {
                "n_sampled_goal": o.n_sampled_goal,
                "goal_selection_strategy": "future",
                "copy_info_dict": True,
            },
        }
    model: BaseAlgorithm = algorithm(
        "MultiInputPolicy",
        env,
        learning_rate=o.learning_rate,
        buffer_size=o.buffer_size,
        learning_starts=o.learning_starts,
        batch_size=o.batch_size,
        tau=o.tau,
        gamma=o.gamma,
        train_freq=o.train_freq,
        gradient_steps=o.gradient_steps,
        policy_kwargs=kwargs,
        seed=seed,
        device="cpu",
        **her,
    )
    return model


def _reseed(model: BaseAlgorithm, env: VecNormalize, seed: int, segment: int) -> None:
    """Begin a segment: new episodes, and random numbers that depend on (seed, segment) alone."""
    mixed = int(np.random.SeedSequence([seed, segment]).generate_state(1)[0])
    random.seed(mixed)
    np.random.seed(mixed)  # noqa: NPY002  (SB3 draws from it)
    torch.manual_seed(mixed)
    model.action_space.seed(mixed)
    env.seed(seed * 1_000_000 + segment * env.num_envs)  # below VALIDATION_SEED
    model._last_obs = None  # learn() then resets the environments
    model.ep_info_buffer = model.ep_info_buffer or None


def _keep(
    path: Path,
    described: dict[str, Any],
    model: BaseAlgorithm,
    env: VecNormalize,
    seconds: float,
    segment: int,
    rows: list[list[float]],
) -> None:
    """Write the checkpoint, whole or not at all."""
    assert isinstance(env.obs_rms, dict)
    rms = env.obs_rms["observation"]
    content = {
        "described": described,
        "parameters": model.get_parameters(),
        "entropy": getattr(model, "log_ent_coef", None),
        "normalization": {
            "mean": torch.from_numpy(rms.mean),
            "var": torch.from_numpy(rms.var),
            "count": float(rms.count),
        },
        "num_timesteps": model.num_timesteps,
        "updates": getattr(model, "_n_updates", 0),
        "seconds": seconds,
        "segment": segment,
        "rows": rows,
    }
    part = path.with_name(path.name + ".part")
    torch.save(content, part)
    os.replace(part, path)


def _restore(
    path: Path, described: dict[str, Any], model: BaseAlgorithm, env: VecNormalize
) -> tuple[float, int, list[list[float]]]:
    """Read a checkpoint into model and environment: (seconds, segment, learning curve so far)."""
    try:
        content = torch.load(path, weights_only=True)
        before = with_later_settings(content["described"], described)
    except Exception as error:
        raise TrainingError(
            f"{path} cannot be read as a checkpoint ({error}); delete it (or use --fresh) to start anew"
        ) from error
    if before != described:
        changed = [key for key in described if before.get(key) != described[key]]
        raise TrainingError(
            f"{path} was written with other settings ({', '.join(changed)} differ): "
            f"train into another folder, or delete it (or use --fresh) to start anew"
        )
    model.set_parameters(content["parameters"], exact_match=True)
    if content["entropy"] is not None:
        model.log_ent_coef.data.copy_(content["entropy"].data)  # type: ignore[attr-defined]
    assert isinstance(env.obs_rms, dict)
    rms = env.obs_rms["observation"]
    saved = content["normalization"]
    rms.mean, rms.var, rms.count = saved["mean"].numpy(), saved["var"].numpy(), saved["count"]
    model.num_timesteps = content["num_timesteps"]
    if hasattr(model, "_n_updates"):
        model._n_updates = content["updates"]
    if hasattr(model, "learning_starts"):  # the replay buffer fills anew
        model.learning_starts += model.num_timesteps
    return content["seconds"], content["segment"], content["rows"]


def _write_curve(path: Path, rows: list[list[float]]) -> None:
    part = path.with_name(path.name + ".part")
    with part.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(CURVE_COLUMNS)
        writer.writerows(rows)
    os.replace(part, path)
