"""Experiments as YAML, validated: an unknown or ill-typed key is an error that names it and says what would work."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import gymnasium as gym
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PositiveFloat,
    ValidationError,
    field_validator,
    model_validator,
)

import tensegrity_envs
from tensegrity_agents import env_options
from tensegrity_agents.controllers import baselines_of, teachers_of
from tensegrity_agents.controllers.corrected import controller_to_correct
from tensegrity_agents.controllers.model_features import ModelFeatures
from tensegrity_agents.own_modules import own_module
from tensegrity_agents.yaml_file import ConfigError, read_yaml
from tensegrity_envs.env import unwrapped
from tensegrity_envs.registration import full_id
from tensegrity_envs.simulation.dynamic import check_smooth

__all__ = ["ConfigError", "Experiment", "TrainConfig", "did_you_mean", "known_env", "load_experiment"]


_MANY = 100_000  # a slip beyond: what is so large ends in lack of memory


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class PPOSettings(_Strict):
    """Stable-Baselines3's PPO, with its names."""

    num_envs: int = Field(512, ge=1, le=_MANY, description="environments stepped as one batch")
    n_steps: int = Field(16, ge=1, le=_MANY)

    @model_validator(mode="after")
    def _is_a_batch(self) -> "PPOSettings":
        if self.num_envs * self.n_steps < 2:
            raise ValueError("num_envs * n_steps must be at least 2: advantages are normalized over a rollout")
        return self

    batch_size: int = Field(4096, ge=2)
    n_epochs: int = Field(8, ge=1)
    gamma: float = Field(0.95, gt=0, le=1)
    gae_lambda: float = Field(0.95, ge=0, le=1)
    learning_rate: float = Field(2e-3, gt=0, description="at the start; falls linearly to zero")
    clip_range: float = Field(0.2, gt=0)
    ent_coef: float = Field(0.0, ge=0)
    log_std_init: float = Field(-0.5, ge=-20, le=5)
    log_std_end: float | None = Field(
        None,
        ge=-20,
        le=5,
        description="log std of the exploration falls or rises linearly from log_std_init to this one, untrained",
    )
    value_rollouts: int = Field(
        0,
        ge=0,
        description="after a teacher, a gradient, or where a controller is corrected, so many rollouts train the value "
        "function alone, not the policy",
    )


class TeacherSettings(_Strict):
    """A teacher that is told the truth shows the agent what to do where the agent comes to, before PPO begins.

    See `sb3.teacher_student`.
    """

    controller: str = Field("oracle", description="see controllers.teachers_of; it is told the truth")
    timesteps: int = Field(ge=1, description="environment steps with the teacher, the first of total_timesteps")
    n_steps: int = Field(
        20, ge=1, le=_MANY, description="environment steps between two trainings, in each of ppo.num_envs"
    )
    gradient_steps: int = Field(60, ge=1, description="of each training")
    batch_size: int = Field(2048, ge=1)
    buffer_size: int = Field(400_000, ge=1, description="the latest steps, which are trained on")
    learning_rate: float = Field(1e-3, gt=0, description="at the start; falls linearly to a fiftieth")
    beta: float = Field(0.05, gt=0, description="error of an action from which on the loss is linear: smooth L1")
    edge_weight: float = Field(
        1.0,
        ge=1,
        description="weight of steps at the edge of the stable set; it falls to 1 at a stability margin of 0.25",
    )
    rounds_with_teacher: int = Field(
        3, ge=0, description="the share of actions that are the teacher's own falls from 1 to 0 in so many rounds"
    )
    horizon: int = Field(60, ge=1, description="steps that the teacher plans ahead")
    replan_after: int = Field(25, ge=1, description="steps after which the teacher plans anew")
    plan_every: int = Field(
        1,
        ge=1,
        description="steps from one planning to the next: those who wait are planned for together, which is faster",
    )
    careful_below: float = Field(
        0.0, ge=0, description="stability margin below which the teacher's steps get shorter, down to a quarter"
    )


class CorrectionSettings(_Strict):
    """The agent corrects an analytic controller. See `sb3.correction` and `sb3.feedback_correction`."""

    controller: str = Field(description="that plans the inputs at full speed, or has feedback and can be corrected")
    by: float = Field(4.0, gt=0, le=1000, strict=True, description="largest correction, in steps of the inputs' rate")


class GradientSettings(_Strict):
    """Training through the gradient of the dynamics, before PPO begins. See `sb3.descent`."""

    timesteps: int = Field(
        ge=1, description="environment steps through which gradients go, the first of all; rounded up to whole updates"
    )
    num_envs: int = Field(256, ge=1, le=_MANY, description="episodes in one gradient")
    horizon: int = Field(40, ge=2, description="steps of each, from its beginning on")
    learning_rate: float = Field(1e-3, gt=0, le=1, description="at the start; falls linearly to zero")
    substeps: int = Field(5, ge=1, le=1000, description="time steps in each step")
    settling: float = Field(
        0.0, ge=0, le=1, description="share of the cost that counts the largest error to come, not that of the moment"
    )
    most_sensitive: float | None = Field(
        20.0, ge=1, description="times the median to which an episode's gradient in its state is shortened; null: never"
    )


class PrivilegedSettings(_Strict):
    """What training alone is told: load, draws of the episode and the true state. See `sb3.privileged`."""

    identify: float = Field(
        0.5, ge=0, description="weight of the error with which the policy's last hidden layer estimates them"
    )


class OffPolicySettings(_Strict):
    """Stable-Baselines3's SAC and TD3, sb3-contrib's TQC and CrossQ, with their names."""

    num_envs: int = Field(
        1, ge=1, le=_MANY, description="environments stepped as one batch; more than one are the native vector"
    )
    her: bool = Field(True, description="hindsight experience replay, future strategy; not with crossq")
    n_sampled_goal: int = Field(4, ge=1)
    buffer_size: int = Field(300_000, ge=1)
    learning_starts: int = Field(2_000, ge=1)
    batch_size: int = Field(256, ge=1)
    gamma: float = Field(0.95, gt=0, le=1)
    tau: float = Field(0.02, gt=0, le=1)
    learning_rate: float = Field(1e-3, gt=0, description="at the start; falls linearly to zero")
    train_freq: int = Field(4, ge=1, description="steps of all environments between two trainings")
    gradient_steps: int = Field(4, ge=1)
    action_noise: float = Field(0.1, ge=0, description="standard deviation of the exploration of td3")


class TrainConfig(_Strict):
    """How an agent is trained."""

    algorithm: Literal["ppo", "recurrent_ppo", "sac", "td3", "tqc", "crossq"] = "ppo"
    total_timesteps: int = Field(ge=1)
    segment_timesteps: int = Field(
        500_000, ge=1, description="a checkpoint after each; environments are reset and random numbers reseeded there"
    )
    net_arch: list[Annotated[int, Field(ge=1, le=_MANY)]] = Field([128, 128], min_length=1, max_length=100)
    activation: Literal["relu", "tanh"] = "relu"
    goal_error_scales: list[PositiveFloat] = Field([0.5, 0.1, 0.02], min_length=1, description="see GoalErrorExtractor")
    goal_scale: float = Field(
        0.5, ge=1e-6, le=1e6, description="divides goals before the network sees them [m]; such as half the reach"
    )
    goal_is_angles: bool = Field(False, description="goals are angles on the torus, see GoalErrorExtractor")
    model_hints: bool = Field(
        False,
        description="the agent also observes model-based features, see controllers.model_features",
    )
    history: int = Field(
        0,
        ge=0,
        le=1000,
        description="observations and actions of so many steps before, and the first observation, are seen",
    )
    lstm_hidden_size: int = Field(64, ge=1, le=_MANY, description="units of the memory of recurrent_ppo")
    levels: list[int] | None = Field(
        None,
        min_length=1,
        description="of uncertainty while training, such as [0, 1, 2, 3]: an equal share of the environments is at "
        "each, which the agent is not told; by default that of the environment",
    )
    repeat_failed: float = Field(
        0.0,
        ge=0,
        lt=1,
        description="probability that an episode that ended without success is begun again; on-policy algorithms only",
    )
    teacher: TeacherSettings | None = Field(
        None, description="shows the agent what to do before PPO begins; see sb3.teacher_student"
    )
    corrects: CorrectionSettings | None = Field(
        None, description="an analytic controller's plan, which the agent's actions correct; see sb3.correction"
    )
    gradient: GradientSettings | None = Field(
        None, description="of the dynamics, by which the agent is trained before PPO begins; see sb3.descent"
    )
    privileged: PrivilegedSettings | None = Field(
        None, description="hidden numbers for the value function and for an estimate while training; ppo only"
    )
    env_options: dict[str, Any] = Field(
        {},
        description="further arguments of the environment while training; its design, randomization, tolerance and "
        "ranges of loads count in the evaluation, too, unless the experiment says otherwise",
    )
    ppo: PPOSettings = PPOSettings()
    off_policy: OffPolicySettings = OffPolicySettings()
    threads: int = Field(
        1, ge=1, le=1024, description="Torch threads; more than one is slow where other programs run beside it"
    )

    @property
    def is_on_policy(self) -> bool:
        """Whether the algorithm learns from what its present policy does, with the settings below `ppo`."""
        return self.algorithm in ("ppo", "recurrent_ppo")

    @model_validator(mode="after")
    def _takes_goals(self) -> "TrainConfig":
        if self.algorithm == "crossq" and self.off_policy.her:
            raise ValueError("off_policy: crossq sees observations as one vector, without goals to change: her: false")
        return self

    @model_validator(mode="after")
    def _is_told(self) -> "TrainConfig":
        if self.privileged is not None and (self.algorithm != "ppo" or self.ppo.ent_coef):
            raise ValueError("privileged: needs algorithm: ppo and ent_coef: 0, in whose place the estimate is learned")
        return self

    @model_validator(mode="after")
    def _trains_the_policy(self) -> "TrainConfig":
        taught = max((one.timesteps for one in (self.teacher, self.gradient) if one is not None), default=0)
        left, rollout = self.total_timesteps - taught, self.ppo.num_envs * self.ppo.n_steps
        alone = self.ppo.value_rollouts * rollout
        begins_well = taught > 0 or self.corrects is not None  # otherwise none is for the value function alone
        if self.is_on_policy and begins_well and 0 < left <= alone:
            raise ValueError(
                f"ppo.value_rollouts {self.ppo.value_rollouts}: rollouts of num_envs * n_steps = {rollout} steps would "
                f"train the value function for all {left} steps, and the policy never; make total_timesteps larger"
            )
        return self

    @model_validator(mode="after")
    def _repeats(self) -> "TrainConfig":
        if self.repeat_failed and not self.is_on_policy:
            raise ValueError(f"repeat_failed: needs algorithm: ppo or recurrent_ppo, not {self.algorithm}")
        return self


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
    design: Any = Field(None, description="name of a published design, some fields, or a YAML file with fields")
    randomization: dict[str, Any] | None = Field(None, description="what differs between episodes, with its ranges")
    level: int | list[int] | Literal["drawn"] | None = Field(
        None,
        description="of uncertainty, 0 to 3, or several of which each episode has one; see tensegrity_envs.uncertainty",
    )
    tolerance: float | None = Field(None, gt=0, description="distance from the target that counts as reached")
    load_range: list[float] | None = Field(None, description="of unknown loads at the tip, as the environment has it")
    payload_range: list[float] | None = Field(None, description="of unknown payloads [kg]")
    env_options: dict[str, Any] = Field(
        {}, description="further arguments of the environment, in training and evaluation, such as segments: 4"
    )

    @field_validator("env")
    @classmethod
    def _known_env(cls, value: str) -> str:
        return known_env(value)

    @field_validator("level", mode="before")
    @classmethod
    def _readable_level(cls, value: object) -> Any:
        return env_options.parse_level(str(value), "") if isinstance(value, bool | str) else value

    @field_validator("design")
    @classmethod
    def _readable_design(cls, value: object) -> Any:
        return env_options.parse_design(value, "design:") if isinstance(value, str) else value

    @property
    def options(self) -> dict[str, Any]:
        """The environment's options that count in training and evaluation."""
        given = {name: getattr(self, name) for name in env_options.NAMES}
        own = {name: value for name, value in given.items() if value is not None}
        trained = {name: value for name, value in self.train.env_options.items() if name in env_options.NAMES}
        return trained | self.env_options | own

    @property
    def training_options(self) -> dict[str, Any]:
        """Those of the training environments."""
        return self.options | self.train.env_options

    @property
    def results_name(self) -> str:
        """Name of the folder for results: the environment's; with options of one's own, a hash of these after it."""
        return env_options.results_name(self.env, self.options)

    def changed(self, **changes: Any) -> "Experiment":
        """The same experiment with other values, validated.

        Raises:
            ConfigError: a value does not fit.
        """
        return _validated(self.model_dump() | changes, "")

    @field_validator("seeds")
    @classmethod
    def _usable_seeds(cls, value: list[int]) -> list[int]:
        if len(set(value)) != len(value) or min(value) < 0 or max(value) >= 900:
            raise ValueError(f"{value}: must be different numbers from 0 to 899")
        return value

    @model_validator(mode="after")
    def _options_fit(self) -> "Experiment":
        env_options.check_own(self.env_options, "env_options")
        env_options.check_own(self.train.env_options, "train.env_options", frozenset({"max_episode_steps"}))
        evaluated = env_options.check_options(self.env, self.options)
        trained = env_options.check_options(self.env, self.training_options)
        spaces = [
            (core.observation_space["observation"].shape, core.action_space.shape) for core in (evaluated, trained)
        ]
        if spaces[0] != spaces[1]:
            raise ValueError(
                f"train.env_options: an agent with observations and actions of sizes {spaces[1]} cannot be evaluated "
                f"on {self.env}, where they are {spaces[0]}"
            )
        return self

    @model_validator(mode="after")
    def _controllers_are_known(self) -> "Experiment":
        known = baselines_of(self.env, self.options)
        for name in self.controllers or []:
            if name not in known and ":" not in name:
                raise ValueError(f"no controller {name!r}; there are {', '.join(known)}, or your own as 'module:Class'")
        return self

    @property
    def compared(self) -> list[str]:
        """The controllers that agents are compared with: those given, else all baselines of the environment."""
        return list(baselines_of(self.env, self.options)) if self.controllers is None else self.controllers

    @model_validator(mode="after")
    def _hints_are_there(self) -> "Experiment":
        if self.train.model_hints:
            ModelFeatures(self.env, self.options)
            if not self.train.is_on_policy and self.train.off_policy.her:
                raise ValueError("model_hints: true does not go with her: true, which changes goals but not features")
        return self

    @model_validator(mode="after")
    def _teacher_fits(self) -> "Experiment":
        train, teacher = self.train, self.train.teacher
        if teacher is None:
            return self
        if train.algorithm != "ppo":
            raise ValueError(f"teacher: needs algorithm: ppo, not {train.algorithm}")
        if teacher.timesteps > train.total_timesteps:
            raise ValueError(f"teacher.timesteps: at most total_timesteps, {train.total_timesteps}")
        known = teachers_of(self.env, self.training_options)
        if teacher.controller not in known:
            raise ValueError(
                f"teacher.controller: no {teacher.controller!r} for {self.env}; there are {', '.join(known)}"
            )
        return self

    @model_validator(mode="after")
    def _plan_fits(self) -> "Experiment":
        train = self.train
        if train.corrects is not None:
            try:
                controller_to_correct(train.corrects.controller, self.env, self.options)
            except ValueError as error:
                raise ValueError(f"corrects.controller: {error}") from error
            if train.teacher is not None:
                raise ValueError("corrects: does not go with teacher, which shows whole actions, not corrections")
            if not train.is_on_policy:
                raise ValueError(f"corrects: needs algorithm: ppo or recurrent_ppo, not {train.algorithm}")
        if train.gradient is not None:
            others = [name for name in ("teacher", "privileged") if getattr(train, name) is not None]
            if train.algorithm != "ppo" or others:
                given = ", ".join([f"algorithm: {train.algorithm}", *others])
                raise ValueError(f"gradient: needs algorithm: ppo, without teacher and privileged; given: {given}")
            if train.model_hints or train.goal_is_angles:
                raise ValueError("gradient: does not go with model_hints: true and goal_is_angles: true")
            if train.gradient.timesteps > train.total_timesteps:
                raise ValueError(
                    f"gradient.timesteps {train.gradient.timesteps}: at most total_timesteps, {train.total_timesteps}"
                )
            limit = gym.spec(self.env).max_episode_steps
            if limit and train.gradient.horizon > limit:
                raise ValueError(f"gradient.horizon {train.gradient.horizon}: an episode has {limit} steps")
            try:
                check_smooth(unwrapped(gym.make(self.env, **self.training_options)).core)
            except ValueError as error:
                raise ValueError(f"gradient: {error}") from error
        return self

    @model_validator(mode="after")
    def _levels_fit(self) -> "Experiment":
        train, levels = self.train, self.train.levels
        if levels is None:
            return self
        if not train.is_on_policy:
            raise ValueError(f"levels: needs algorithm: ppo or recurrent_ppo, not {train.algorithm}")
        if len(set(levels)) != len(levels) or len(levels) > train.ppo.num_envs:
            raise ValueError(f"levels {levels}: must be different ones, at most as many as ppo.num_envs")
        for level in levels:
            env_options.check_options(self.env, self.training_options | {"level": level})
        return self

    @model_validator(mode="after")
    def _hindsight_finds_episodes(self) -> "Experiment":
        off, limit = self.train.off_policy, gym.spec(self.env).max_episode_steps or 0
        least = limit * off.num_envs
        if not self.train.is_on_policy and off.her and min(off.learning_starts, off.buffer_size) < least:
            raise ValueError(
                "off_policy: with her: true, learning_starts and buffer_size must be at least one episode of each "
                f"environment, {least}"
            )
        return self


def known_env(name: str) -> str:
    """The full id of an environment.

    Args:
        name: an id of this package, with or without "tensegrity/", or one of your own as "module:id", as Gymnasium has
            it: the module is imported, from the path or the working directory, and registers it.

    Raises:
        ConfigError: there is none of this name.
    """
    module, _, own = name.rpartition(":")
    if module:
        try:
            own_module(module)
        except ImportError as error:
            raise ConfigError(f"environment {name!r}: {error}") from error
    if own in gym.registry and "arm" in gym.spec(own).kwargs:
        return own
    if module and own in gym.registry:
        raise ConfigError(f"environment {name!r}: it is not made of a Core (see CONTRIBUTING.md)")
    if module:
        raise ConfigError(f"environment {name!r}: {module} registers no {own!r}")
    full = full_id(name)
    if full not in tensegrity_envs.ENV_IDS:
        hint = did_you_mean(name, tensegrity_envs.ENV_IDS)
        raise ConfigError(f"no environment {name!r}{hint or ';'} `tensegrity list` tells all, your own is 'module:id'")
    return full


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The nearest few of the known ids as a question, which is empty where none is near; all without namespaces."""

    def bare(env_id: str) -> str:
        return env_options.short_name(env_id).lower().removesuffix("-v0")

    spelt = {bare(env_id): env_options.short_name(env_id) for env_id in known}
    close = [spelt[one] for one in get_close_matches(bare(name), spelt, 3, 0.5)]
    if not close:
        return ""
    *others, last = close
    return f": did you mean {', '.join(others)}{' or ' if others else ''}{last}?"


def load_experiment(path: Path) -> Experiment:
    """Read and validate an experiment.

    Raises:
        ConfigError: the file is not there, is not YAML, or holds something that does not fit.
    """
    if not path.is_file():
        others = sorted(str(p) for p in path.parent.glob("*.yaml")) if path.parent.is_dir() else []
        raise ConfigError(f"no config {path}; there are: {', '.join(others) or 'none in that folder'}")
    return _validated(read_yaml(path, "env: tensegrity/TwoXReach-v0"), f"{path}:")


def _validated(content: dict[str, Any], where: str) -> Experiment:
    try:
        return Experiment(**content)
    except ValidationError as error:
        lines = [where, *(_explain(item) for item in error.errors())]
        raise ConfigError("\n".join(line for line in lines if line)) from error


def _explain(item: Any) -> str:
    where = ".".join(str(part) for part in item["loc"])
    if item["type"] != "extra_forbidden":
        given = "" if item["type"] in ("missing", "value_error") else f", got {item['input']!r}"
        said = f"{item['msg'].removeprefix('Value error, ')}{given}"
        return f"  {where}: {said}" if where else f"  {said}"  # what concerns several keys names them
    model: Any = Experiment
    for part in item["loc"][:-1]:
        if part in getattr(model, "model_fields", {}):
            annotation = model.model_fields[part].annotation
            model = next((kind for kind in get_args(annotation) if hasattr(kind, "model_fields")), annotation)
    known = list(model.model_fields)
    close = get_close_matches(str(item["loc"][-1]), known, 1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"  {where}: no such key; {hint}There are {', '.join(known)}"
