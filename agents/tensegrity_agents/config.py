"""Experiments as YAML, validated: an unknown or ill-typed key is an error that names it and says what would work."""

from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

import tensegrity_envs
from tensegrity_agents.controllers import baselines_of
from tensegrity_agents.sb3.hints import Hints


class ConfigError(ValueError):
    """A config that cannot be used; the message names file, key, what was given and what would work."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PPOSettings(_Strict):
    """Stable-Baselines3's PPO, with its names."""

    num_envs: int = Field(512, ge=1, description="environments stepped as one batch")
    n_steps: int = Field(16, ge=1)
    batch_size: int = Field(4096, ge=2)
    n_epochs: int = Field(8, ge=1)
    gamma: float = Field(0.95, gt=0, le=1)
    gae_lambda: float = Field(0.95, ge=0, le=1)
    learning_rate: float = Field(2e-3, gt=0, description="at the start; falls linearly to zero")
    clip_range: float = Field(0.2, gt=0)
    ent_coef: float = Field(0.0, ge=0)
    log_std_init: float = -0.5


class OffPolicySettings(_Strict):
    """Stable-Baselines3's SAC and sb3-contrib's TQC on the single environment, with their names."""

    her: bool = Field(True, description="hindsight experience replay, future strategy")
    n_sampled_goal: int = Field(4, ge=1)
    buffer_size: int = Field(300_000, ge=1)
    learning_starts: int = Field(2_000, ge=1)
    batch_size: int = Field(256, ge=1)
    gamma: float = Field(0.95, gt=0, le=1)
    tau: float = Field(0.02, gt=0, le=1)
    learning_rate: float = Field(1e-3, gt=0, description="at the start; falls linearly to zero")
    train_freq: int = Field(4, ge=1)
    gradient_steps: int = Field(4, ge=1)


class TrainConfig(_Strict):
    """How an agent is trained."""

    algorithm: Literal["ppo", "sac", "tqc"] = "ppo"
    total_timesteps: int = Field(ge=1)
    segment_timesteps: int = Field(
        500_000, ge=1, description="a checkpoint after each; environments are reset and random numbers reseeded there"
    )
    net_arch: list[int] = Field([128, 128], min_length=1)
    activation: Literal["relu", "tanh"] = "relu"
    goal_error_scales: list[float] = Field([0.5, 0.1, 0.02], min_length=1, description="see GoalErrorExtractor")
    goal_scale: float = Field(
        0.5, gt=0, description="divides goals before the network sees them [m]; such as half the reach"
    )
    goal_is_angles: bool = Field(False, description="goals are angles on the torus, see GoalErrorExtractor")
    model_hints: bool = Field(
        False, description="the nominal model tells the agent what it makes of the observation, see sb3.hints"
    )
    env_options: dict[str, Any] = Field({}, description="further arguments of the environment while training")
    ppo: PPOSettings = PPOSettings()
    off_policy: OffPolicySettings = OffPolicySettings()
    threads: int = Field(1, ge=1, description="Torch threads; more than one is slow where other programs run beside it")


class Experiment(_Strict):
    """One experiment: an environment, how agents are trained on it, and what they are compared with."""

    env: str
    train: TrainConfig
    seeds: list[int] = Field([0], min_length=1, description="training seeds, one agent each")
    controllers: list[str] | None = Field(
        None, description="names of baselines, or module:Class; all of the environment's baselines by default"
    )
    episodes: int = Field(1000, ge=1, description="held-out test episodes")
    video_episode: int = Field(0, ge=0, description="which test episode the video shows")

    @field_validator("env")
    @classmethod
    def _known_env(cls, value: str) -> str:
        value = value if value.startswith("tensegrity/") else f"tensegrity/{value}"
        if value not in tensegrity_envs.ENV_IDS:
            close = get_close_matches(value, tensegrity_envs.ENV_IDS, 1)
            hint = f" (did you mean {close[0]}?)" if close else ""
            raise ValueError(f"no environment {value!r}{hint}; there are {', '.join(tensegrity_envs.ENV_IDS)}")
        return value

    @field_validator("seeds")
    @classmethod
    def _usable_seeds(cls, value: list[int]) -> list[int]:
        if len(set(value)) != len(value) or min(value) < 0 or max(value) >= 900:
            raise ValueError(f"seeds {value}: must be different numbers from 0 to 899")
        return value

    @model_validator(mode="after")
    def _controllers_are_known(self) -> "Experiment":
        known = baselines_of(self.env)
        for name in self.controllers or []:
            if name not in known and ":" not in name:
                raise ValueError(f"no controller {name!r}; there are {', '.join(known)}, or your own as 'module:Class'")
        return self

    @property
    def compared(self) -> list[str]:
        """The controllers that agents are compared with: those given, else all baselines of the environment."""
        return list(baselines_of(self.env)) if self.controllers is None else self.controllers

    @model_validator(mode="after")
    def _hints_are_there(self) -> "Experiment":
        if self.train.model_hints:
            Hints(self.env)
            if self.train.algorithm != "ppo" and self.train.off_policy.her:
                raise ValueError("model_hints: true does not go with her: true, which changes goals but not hints")
        return self

    @model_validator(mode="after")
    def _env_options_fit(self) -> "Experiment":
        try:
            gym.make(self.env, **self.train.env_options).close()
        except TypeError as error:
            raise ValueError(f"env_options {self.train.env_options}: {error}") from error
        return self


def load_experiment(path: Path) -> Experiment:
    """Read and validate an experiment.

    Raises:
        ConfigError: the file is not there, is not YAML, or holds something that does not fit.
    """
    if not path.is_file():
        others = sorted(str(p) for p in path.parent.glob("*.yaml")) if path.parent.is_dir() else []
        raise ConfigError(f"no config {path}; there are: {', '.join(others) or 'none in that folder'}")
    try:
        content = yaml.safe_load(path.read_text())
    except yaml.YAMLError as error:
        raise ConfigError(f"{path} is not valid YAML: {error}") from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: must hold keys and values, such as 'env: tensegrity/TwoXReach-v0'")
    try:
        return Experiment(**content)
    except ValidationError as error:
        raise ConfigError(f"{path}:\n" + "\n".join(_explain(item) for item in error.errors())) from error


def _explain(item: Any) -> str:
    where = ".".join(str(part) for part in item["loc"]) or "the whole"
    if item["type"] != "extra_forbidden":
        given = "" if item["type"] in ("missing", "value_error") else f", got {item['input']!r}"
        return f"  {where}: {item['msg'].removeprefix('Value error, ')}{given}"
    model: Any = Experiment
    for part in item["loc"][:-1]:
        model = model.model_fields[part].annotation
    known = list(model.model_fields)
    close = get_close_matches(str(item["loc"][-1]), known, 1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"  {where}: no such key; {hint}There are {', '.join(known)}"
