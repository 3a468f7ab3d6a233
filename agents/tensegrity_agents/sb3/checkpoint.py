"""Checkpoints of a training: all that what follows depends on, in a file that runs nothing when it is read."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from pydantic import BaseModel
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from tensegrity_agents.config import (
    CorrectionSettings,
    GradientSettings,
    OffPolicySettings,
    PPOSettings,
    TeacherSettings,
    TrainConfig,
)
from tensegrity_agents.controllers.base import ragged
from tensegrity_agents.sb3 import random_numbers
from tensegrity_agents.sb3.augmented import AugmentedVecEnv
from tensegrity_agents.sb3.errors import TrainingError
from tensegrity_agents.sb3.levels import LevelsVecEnv
from tensegrity_agents.sb3.policy_file import statistics_of
from tensegrity_agents.sb3.privileged import PRIVILEGED, PrivilegedVecEnv
from tensegrity_agents.sb3.vec_env import VectorEnvAdapter
from tensegrity_agents.whole_file import written_whole
from tensegrity_envs.compiler.pytree import is_array, tree_leaves, tree_map

CHECKPOINT = "checkpoint.pt"
_RAGGED = "arrays of different lengths"


class Progressed(NamedTuple):
    """How far a training has come.

    Attributes:
        seconds: spent training.
        segment: number of the segment.
        segment_end: its last time step; None at the beginning of a segment.
        rows: of the learning curve.
        evaluations: rows of the evaluations.
        episodes: state of the latest training episodes, see `CompleteEpisodes.state`; None if there is none.
        running: state of environments and random numbers within a segment, see `running_state`; None at its beginning.
        teaching: what teacher and student have come to, see `teacher_student.Lessons.state`; None if there is none.
    """

    seconds: float
    segment: int
    segment_end: int | None
    rows: list[list[float]]
    evaluations: list[list[float]]
    episodes: dict[str, Any] | None
    running: dict[str, Any] | None
    teaching: dict[str, Any] | None = None


def keep(path: Path, described: dict[str, Any], model: BaseAlgorithm, env: VecNormalize, so_far: Progressed) -> None:
    """Write a checkpoint, whole or not at all.

    Args:
        path: of the file.
        described: the experiment; a checkpoint of another one is not gone on with.
        model: of Stable-Baselines3.
        env: its environments.
        so_far: how far the training has come.
    """
    content = {
        "described": described,
        "parameters": model.get_parameters(),
        "entropy": getattr(model, "log_ent_coef", None),
        "normalization": _numbers_of(statistics_of(env)),
        "told": _numbers_of(_told(env)),
        "num_timesteps": model.num_timesteps,
        "updates": getattr(model, "_n_updates", 0),
        **so_far._asdict(),
    }
    with written_whole(path) as part:
        torch.save(_mapped(content, np.ndarray, _tensors), part)


def restore(path: Path, described: dict[str, Any], model: BaseAlgorithm, env: VecNormalize) -> Progressed:
    """Read a checkpoint into model and environments.

    Raises:
        TrainingError: it is of another experiment, or cannot be read.
    """
    try:
        content = torch.load(path, weights_only=True)
        before = with_later_settings(content["described"], described)
        if before == described:
            return _restored(content, model, env)
    except Exception as error:
        raise TrainingError(
            f"{path} cannot be read as a checkpoint ({type(error).__name__}: {error}); "
            "delete it (or use --fresh) to start anew"
        ) from error
    changed = [key for key in described if before.get(key) != described[key]]
    raise TrainingError(
        f"{path} was written with other settings ({', '.join(changed)} differ): "
        f"train into another folder, or delete it (or use --fresh) to start anew"
    )


def _restored(content: dict[str, Any], model: BaseAlgorithm, env: VecNormalize) -> Progressed:
    found: dict[str, Any] = {
        name: content.get(name, [] if name == "evaluations" else None) for name in Progressed._fields
    }
    found |= {
        name: _mapped(found[name], torch.Tensor, lambda tensor: tensor.numpy().copy())
        for name in ("episodes", "running", "teaching")
    }
    if found["teaching"] is not None:
        found["teaching"]["optimizer"] = content["teaching"]["optimizer"]  # which is Torch's own
    so_far = Progressed(**found)
    model.set_parameters(content["parameters"], exact_match=True)
    if content["entropy"] is not None:
        off_policy: Any = model
        off_policy.log_ent_coef.data.copy_(content["entropy"].data)
    for rms, saved in ((statistics_of(env), content["normalization"]), (_told(env), content.get("told"))):
        if rms is not None and saved is not None:
            rms.mean, rms.var, rms.count = saved["mean"].numpy(), saved["var"].numpy(), saved["count"]
    model.num_timesteps = content["num_timesteps"]
    if hasattr(model, "_n_updates"):
        model._n_updates = content["updates"]
    if hasattr(model, "learning_starts"):  # the replay buffer fills anew
        model.learning_starts += model.num_timesteps
    return so_far


def _numbers_of(rms: RunningMeanStd | None) -> dict[str, Any] | None:
    """Running statistics as a checkpoint holds them."""
    return None if rms is None else {"mean": rms.mean, "var": rms.var, "count": float(rms.count)}


def _told(env: VecNormalize) -> RunningMeanStd | None:
    """The running statistics of what training alone is told; None if it is told nothing."""
    return env.obs_rms.get(PRIVILEGED) if isinstance(env.obs_rms, dict) else None


def running_state(model: BaseAlgorithm, env: VecNormalize) -> dict[str, Any]:
    """What a training on native environments depends on between two rollouts, beside model and normalization."""
    monitor, augmented, _, adapter = _parts(env)
    memories = [None if one.memory is None else list(tree_leaves(one.memory, is_array)) for one in augmented]
    return {
        "environments": adapter.shell.get_state(),
        "returns": monitor.episode_returns.copy(),
        "lengths": monitor.episode_lengths.copy(),
        "memories": memories,
        "observation": model._last_obs,
        "starts": model._last_episode_starts,
        "hidden": _hidden_state(model),
        **random_numbers.get_state(),
    }


def _hidden_state(model: BaseAlgorithm) -> list[torch.Tensor] | None:
    """What a recurrent policy carries from step to step; None if there is none."""
    states = getattr(model, "_last_lstm_states", None)
    return None if states is None else [part for pair in states for part in pair]


def _filled(memory: Any, arrays: list[np.ndarray]) -> Any:
    """A memory of this form with these arrays."""
    parts = iter(arrays)
    return tree_map(lambda _: next(parts), memory, is_array)


def go_on(state: dict[str, Any], model: BaseAlgorithm, env: VecNormalize) -> None:
    """Go on where `running_state` was taken."""
    monitor, augmented, privileged, adapter = _parts(env)
    monitor.venv.reset()  # which makes what the states go into
    adapter.shell.set_state(state["environments"])
    if privileged is not None:
        privileged.look()
    monitor.episode_returns, monitor.episode_lengths = state["returns"], state["lengths"]
    for one, memory in zip(augmented, state["memories"], strict=True):
        one.memory = None if memory is None else _filled(one.memory, memory)
    model._last_obs, model._last_episode_starts = state["observation"], state["starts"]
    if state.get("hidden") is not None:
        recurrent: Any = model
        pi_h, pi_c, vf_h, vf_c = (torch.as_tensor(part) for part in state["hidden"])
        recurrent._last_lstm_states = RNNStates((pi_h, pi_c), (vf_h, vf_c))
    random_numbers.set_state(state)


def with_later_settings(before: dict[str, Any], described: dict[str, Any]) -> dict[str, Any]:
    """Settings as they were recorded, completed by those that came later, which had their default then."""
    later: dict[str, Any] = {"options": {}} | _defaults(TrainConfig)
    settings = {key: later[key] for key in described if key in later} | before
    parts: dict[str, type[BaseModel]] = {
        "ppo": PPOSettings,
        "off_policy": OffPolicySettings,
        "teacher": TeacherSettings,
        "corrects": CorrectionSettings,
        "gradient": GradientSettings,
    }
    for key, model in parts.items():
        if isinstance(before.get(key), dict):
            settings[key] = _defaults(model) | before[key]
    return settings


def _defaults(model: type[BaseModel]) -> dict[str, Any]:
    """The defaults of those settings that have some, as JSON has them: lists, not tuples."""
    defaults = {
        key: field.get_default(call_default_factory=True)
        for key, field in model.model_fields.items()
        if not field.is_required()
    }
    return {key: list(value) if isinstance(value, tuple) else value for key, value in defaults.items()}


def adapter_of(env: VecNormalize) -> VectorEnvAdapter | LevelsVecEnv:
    """The adapter within the wrappers of a training's environments."""
    return _parts(env)[3]


def _parts(
    env: VecNormalize,
) -> tuple[VecMonitor, list[AugmentedVecEnv], PrivilegedVecEnv | None, VectorEnvAdapter | LevelsVecEnv]:
    """The wrappers and the adapter within."""
    monitor: Any = env.venv
    inner: Any = monitor.venv
    augmented = []
    while isinstance(inner, AugmentedVecEnv):
        augmented.append(inner)
        inner = inner.venv
    privileged = inner if isinstance(inner, PrivilegedVecEnv) else None
    return monitor, augmented, privileged, inner.venv if privileged else inner


def _tensors(array: np.ndarray) -> Any:
    """An array as a checkpoint holds it, which holds no objects: of an array of arrays, a dict of their list."""
    return {_RAGGED: [torch.from_numpy(part) for part in array]} if array.dtype == object else torch.from_numpy(array)


def _mapped(tree: Any, kind: type[Any], change: Callable[[Any], Any]) -> Any:
    """The same nested dicts, lists and tuples, with all leaves of a kind changed."""
    if isinstance(tree, kind):
        return change(tree)
    if isinstance(tree, dict) and set(tree) == {_RAGGED}:
        return ragged([_mapped(part, kind, change) for part in tree[_RAGGED]])
    if isinstance(tree, dict):
        return {key: _mapped(value, kind, change) for key, value in tree.items()}
    if isinstance(tree, list | tuple) and not hasattr(tree, "_fields"):
        return type(tree)(_mapped(value, kind, change) for value in tree)
    return tree
