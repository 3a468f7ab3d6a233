"""Policies as ONNX files, for machines without Torch and for other languages.

The file takes the raw observation of the environment, as `TrainedPolicy.predict` does: normalization is part of it. A
policy that remembers takes what it remembers as further inputs (`past_observations`, `past_actions` and `first`; a
recurrent one `hidden` and `cell`) and returns it with `next_` before its names; the input `begins` is true where an
episode begins, whatever was remembered. A policy with model-based features takes them as the input `features`: they are
what Python computes, see `controllers.model_features`. A policy that corrects a controller's plan has no such file: the
plan needs the controller (`sb3.correction`).

| input | shape | type |
|---|---|---|
| observation, achieved_goal, desired_goal | (n, size of the entry) | float32 |
| features | (n, number of features) | float32 |
| past_observations | (n, steps, size of observation and features) | float32 |
| past_actions | (n, steps, action size) | float32 |
| first | (n, size of observation and features) | float32 |
| hidden, cell | (n, layers, units) | float32 |
| begins | (n,) | bool |

The output `action`, shape (n, action size), float32, is within [-1, 1].
"""

import json
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from torch.distributions import Distribution

from tensegrity_agents.controllers.base import beginning
from tensegrity_agents.controllers.reminder import Reminder
from tensegrity_agents.extras import need
from tensegrity_agents.sb3.errors import ExportError
from tensegrity_agents.sb3.history import History, Past, remembered, with_action
from tensegrity_agents.sb3.policy_file import TrainedPolicy, augmentations, check_asked
from tensegrity_agents.whole_file import written_whole

METADATA = "tensegrity_agents"  # the key of the description in the file's metadata
# Of actions, which are within [-1, 1]. Both compute in single precision, and how much its rounding grows depends on the
# weights and the processor: one shipped policy differs by 5.5e-6 on one processor and by 1.2e-5 on another.
TOLERANCE = 1e-4
_GOALS = ("observation", "achieved_goal", "desired_goal")
_PAST = ("past_observations", "past_actions", "first")
_HIDDEN = ("hidden", "cell")


class _Graph(torch.nn.Module):
    """What a file computes."""

    mean: torch.Tensor
    deviation: torch.Tensor

    def __init__(self, trained: TrainedPolicy) -> None:
        super().__init__()
        self.policy, self.clip = trained.policy, trained.normalization.clip
        self.features = None if trained.flattening is None else trained.flattening.extractor
        self.remembers = any(isinstance(one, History) for one in trained.augmentations)
        statistics = trained.normalization
        deviation = np.sqrt(np.asarray(statistics.variance, np.float64) + statistics.epsilon)
        self.register_buffer("mean", torch.tensor(statistics.mean, dtype=torch.float64))
        self.register_buffer("deviation", torch.tensor(deviation))

    def forward(
        self,
        observation: torch.Tensor,
        achieved_goal: torch.Tensor,
        desired_goal: torch.Tensor,
        features: torch.Tensor | None = None,
        past_observations: torch.Tensor | None = None,
        past_actions: torch.Tensor | None = None,
        first: torch.Tensor | None = None,
        hidden: torch.Tensor | None = None,
        cell: torch.Tensor | None = None,
        begins: torch.Tensor | None = None,
    ) -> Any:
        """The actions, and what is remembered."""
        seen = observation if features is None else torch.cat([observation, features], dim=1)
        past = Past(past_observations, past_actions, first)
        if self.remembers:
            seen, past = remembered(torch, seen, past, begins)
        shown: Any = {"observation": seen, "achieved_goal": achieved_goal, "desired_goal": desired_goal}
        values = seen
        if self.features is not None:
            values = self.features({name: value.double() for name, value in shown.items()}).float()
        scaled = ((values.double() - self.mean) / self.deviation).clip(-self.clip, self.clip).float()
        shown = scaled if self.features is not None else shown | {"observation": scaled}
        after: tuple[torch.Tensor, ...] = ()
        if hidden is None or cell is None or begins is None:
            action = self.policy._predict(shown, deterministic=True).clip(-1.0, 1.0)
        else:
            action, after = self._recurrent(shown, hidden, cell, begins)
        told = with_action(torch, past, action) if self.remembers else ()
        return (action, *told, *after) if told or after else action

    def _recurrent(self, shown: Any, hidden: torch.Tensor, cell: torch.Tensor, begins: torch.Tensor) -> Any:
        """One step of a recurrent policy, whose own `_predict` asks whether an episode begins: no graph holds that."""
        policy: Any = self.policy
        kept = (~begins).float()[None, :, None]
        features = policy.extract_features(shown, policy.pi_features_extractor)
        before = tuple(kept * state.transpose(0, 1) for state in (hidden, cell))
        out, after = policy.lstm_actor(features[None], before)
        action = policy.action_net(policy.mlp_extractor.forward_actor(out[0])).clip(-1.0, 1.0)
        return action, tuple(state.transpose(0, 1) for state in after)


def export(trained: TrainedPolicy, path: Path, observations: int = 1000) -> float:
    """Write a policy as ONNX, and check the file against the policy.

    Args:
        trained: the policy.
        path: of the file.
        observations: how many to check it on, of episodes that the policy itself runs.

    Returns:
        The largest difference of an action.

    Raises:
        ImportError: the extra "onnx" is not installed.
        ExportError: actions differ by more than `TOLERANCE`, or the policy corrects a controller; the file is not
            written.
    """
    if trained.corrected:
        raise ExportError(
            f"{path}: the policy corrects {trained.corrected}, made by Python code that no graph holds; run it "
            "in Python, by tensegrity_agents.load_policy(folder).predict, or train an agent without `corrects:`"
        )
    need("onnx", "ONNX needs", "onnx", "onnxscript", "onnxruntime")
    graph = _Graph(trained).eval()
    example = _example(trained)
    names = [*example]
    batch = torch.export.Dim("n")
    shapes = {name: {0: batch} for name in names}
    with _quietly():
        program = torch.onnx.export(
            graph,
            (),
            kwargs=example,
            input_names=names,
            output_names=["action", *(f"next_{name}" for name in (*_PAST, *_HIDDEN) if name in example)],
            dynamic_shapes=shapes,
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    program.model.metadata_props[METADATA] = json.dumps(trained.description)
    with written_whole(path) as part:
        program.save(str(part))
        largest = difference(trained, OnnxPolicy(part), observations)
        if not largest <= TOLERANCE:
            raise ExportError(f"{path}: its actions differ from the policy's by up to {largest:.2g}; not written")
    return largest


def _example(trained: TrainedPolicy, n: int = 3) -> dict[str, torch.Tensor]:
    """Inputs of the graph."""
    env = gym.make(trained.description["env"], **(trained.description.get("options") or {}))
    space: Any = env.observation_space
    env.close()
    inputs = {name: torch.zeros(n, *space[name].shape) for name in _GOALS}
    for one in trained.augmentations:
        if isinstance(one, History):
            inputs["past_observations"] = torch.zeros(n, one.length, one.observation_size)
            inputs["past_actions"] = torch.zeros(n, one.length, one.action_size)
            inputs["first"] = torch.zeros(n, one.observation_size)
        else:
            before, space = space["observation"].shape[0], one.space(space)
            inputs["features"] = torch.zeros(n, space["observation"].shape[0] - before)
    if lstm := getattr(trained.policy, "lstm_actor", None):
        inputs |= {name: torch.zeros(n, lstm.num_layers, lstm.hidden_size) for name in _HIDDEN}
    if not {"first", "hidden"}.isdisjoint(inputs):
        inputs["begins"] = torch.ones(n, dtype=torch.bool)
    return inputs


@contextmanager
def _quietly() -> Iterator[None]:
    """Without the checks of distributions, which no graph can hold, and what the exporter says of others' packages."""
    checks, log = Distribution._validate_args, logging.getLogger("torch.onnx")
    level = log.level
    Distribution.set_default_validate_args(False)
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        Distribution.set_default_validate_args(checks)
        log.setLevel(level)


class OnnxPolicy:
    """A policy file of `export` as a controller, run by onnxruntime, without Torch's part in it.

    Args:
        path: of the file.

    Attributes:
        description: what was exported.

    Raises:
        ValueError: it is no file of `export`.
    """

    def __init__(self, path: Path) -> None:
        import onnxruntime

        try:
            settings = onnxruntime.SessionOptions()
            settings.intra_op_num_threads = 1
            self._session = onnxruntime.InferenceSession(str(path), settings, providers=["CPUExecutionProvider"])
            self.description = json.loads(self._session.get_modelmeta().custom_metadata_map[METADATA])
        except Exception as error:  # onnxruntime has many of its own
            raise ValueError(f"{path}: not an ONNX policy of this package ({error})") from error
        found = augmentations(self.description)
        self._features: Any = next((one for one in found if not isinstance(one, History)), None)
        self._shapes = {one.name: one.shape[1:] for one in self._session.get_inputs()}
        self._reminder = Reminder(f"the policy of {path}")

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions for a batch of observations, and what is remembered; see `TrainedPolicy.predict`."""
        check_asked(observation, state, episode_start, self.description.get("observation_shapes") or {})
        if len(self._shapes) > len(_GOALS):
            self._reminder(state)
        n = len(observation["observation"])
        seen, of_features = observation, None
        begins = beginning(n, state, episode_start)
        inputs = {name: np.asarray(observation[name], np.float32) for name in _GOALS}
        if self._features is not None:
            seen, of_features = self._features(observation, None if state is None else state[1], episode_start)
            inputs["features"] = seen["observation"][:, inputs["observation"].shape[1] :]
        if "begins" in self._shapes:
            names = [name for name in (*_PAST, *_HIDDEN) if name in self._shapes]
            before = [np.zeros((n, *self._shapes[name]), np.float32) for name in names] if state is None else state[0]
            inputs |= dict(zip(names, before, strict=True)) | {"begins": begins}
        actions, *after = self._session.run(None, inputs)
        return actions, (after, of_features)


def difference(trained: TrainedPolicy, other: Any, observations: int, envs: int = 20) -> float:
    """The largest difference of actions over episodes that the policy runs; each remembers for itself."""
    steps = -(-observations // envs)
    description = trained.description
    vector = gym.make_vec(
        description["env"], envs, vectorization_mode="vector_entry_point", autoreset_mode="SameStep",
        **(description.get("options") or {}),
    )  # fmt: skip
    observation, _ = vector.reset(seed=0)
    states: list[Any] = [None, None]
    start, largest = np.ones(envs, bool), 0.0
    for _ in range(steps):
        ours, states[0] = trained.predict(observation, states[0], start)
        theirs, states[1] = other.predict(observation, states[1], start)
        largest = max(largest, float(np.abs(ours - theirs).max()))
        observation, _, terminated, truncated, _ = vector.step(ours)
        start = terminated | truncated
    vector.close()
    return largest
