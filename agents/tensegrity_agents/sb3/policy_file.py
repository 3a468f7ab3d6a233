"""Trained policies as safetensors (numbers) and JSON (what they mean): nothing in them can run when they are loaded."""

import hashlib
import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium import spaces
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from sb3_contrib.common.recurrent.policies import RecurrentMultiInputActorCriticPolicy
from sb3_contrib.crossq.policies import CrossQPolicy
from sb3_contrib.tqc.policies import MultiInputPolicy as TQCPolicy
from stable_baselines3.common.policies import BasePolicy, MultiInputActorCriticPolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize
from stable_baselines3.sac.policies import MultiInputPolicy as SACPolicy
from stable_baselines3.td3.policies import MultiInputPolicy as TD3Policy

from tensegrity_agents.controllers.corrected import controller_to_correct
from tensegrity_agents.controllers.model_features import ModelFeatures
from tensegrity_agents.controllers.regulated import FullSpeedPlan
from tensegrity_agents.controllers.reminder import Reminder
from tensegrity_agents.sb3.augmented import Augmentation
from tensegrity_agents.sb3.correction import Correction
from tensegrity_agents.sb3.features import GoalErrorExtractor
from tensegrity_agents.sb3.feedback_correction import FeedbackCorrection
from tensegrity_agents.sb3.flat import Flattening
from tensegrity_agents.sb3.history import History
from tensegrity_agents.whole_file import written_whole
from tensegrity_envs.compiler.pytree import is_array, tree_leaves
from tensegrity_envs.core import Core
from tensegrity_envs.env import unwrapped
from tensegrity_envs.registration import full_id

FORMAT = 1
WEIGHTS, DESCRIPTION = "policy.safetensors", "policy.json"
POLICIES: dict[str, Any] = {
    "ppo": MultiInputActorCriticPolicy,
    "recurrent_ppo": RecurrentMultiInputActorCriticPolicy,
    "sac": SACPolicy,
    "td3": TD3Policy,
    "tqc": TQCPolicy,
    "crossq": CrossQPolicy,  # which takes no Dict
}
_ACTIVATIONS = {"relu": torch.nn.ReLU, "tanh": torch.nn.Tanh}
_NORMALIZE = "normalize."
_VALUE = ("mlp_extractor.value_net.", "value_net.")  # how the names of the value function's tensors begin


class PolicyFileError(ValueError):
    """A policy file that cannot be used; the message names the file and what is wrong with it."""


@dataclass
class Normalization:
    """Running statistics of the "observation" entry or of flat observations, as VecNormalize applies them."""

    mean: np.ndarray
    variance: np.ndarray
    clip: float
    epsilon: float

    @classmethod
    def of(cls, normalizer: VecNormalize) -> "Normalization":
        """The statistics of a VecNormalize that normalizes "observation" alone, or flat observations."""
        rms = statistics_of(normalizer)
        return cls(rms.mean.copy(), rms.var.copy(), float(normalizer.clip_obs), float(normalizer.epsilon))

    def of_flat(self, values: Any) -> np.ndarray:
        """The normalized vector or vectors."""
        scaled = (np.asarray(values) - self.mean) / np.sqrt(self.variance + self.epsilon)
        clipped: np.ndarray = np.clip(scaled, -self.clip, self.clip).astype(np.float32)
        return clipped

    def __call__(self, observation: dict[str, Any]) -> dict[str, np.ndarray]:
        """The normalized observation."""
        return {
            "observation": self.of_flat(observation["observation"]),
            "achieved_goal": np.asarray(observation["achieved_goal"], np.float32),
            "desired_goal": np.asarray(observation["desired_goal"], np.float32),
        }


def statistics_of(normalizer: VecNormalize) -> RunningMeanStd:
    """The running statistics of what is normalized: the entry "observation", or flat observations."""
    rms = normalizer.obs_rms
    return rms["observation"] if isinstance(rms, dict) else rms


def check_asked(observation: Any, state: Any, episode_start: Any, shapes: Mapping[str, Sequence[int]]) -> None:
    """Refuse what is no observation of the environment, or does not go with it.

    Args:
        observation: arrays of these shapes, or of n of them.
        state: None, or two values, which `predict` has returned.
        episode_start: None, or n bools.
        shapes: of the environment's observations.

    Raises:
        TypeError: the observation is no Dict, or the state none of `predict`.
        ValueError: an entry is missing or has another shape, or the numbers of environments differ.
    """
    if not hasattr(observation, "keys"):
        raise TypeError(
            f"predict: the observation is {type(observation).__name__}: must be the environment's, a Dict with "
            "observation, achieved_goal and desired_goal"
        )
    counts: dict[str, tuple[int, ...]] = {}
    for name, shape in shapes.items():
        if name not in observation:
            raise ValueError(f"predict: the observation has no {name}: must be a Dict with {', '.join(shapes)}")
        found = np.shape(observation[name])
        counts[name] = found[: max(len(found) - len(shape), 0)]
        if found[len(counts[name]) :] != tuple(shape) or len(counts[name]) > 1:
            raise ValueError(f"predict: {name} of shape {found}: must be {tuple(shape)}, or n of these in an array")
    if len(set(counts.values())) > 1:
        raise ValueError(f"predict: numbers of environments differ: {counts}")
    count = next((batch[0] for batch in counts.values() if batch), 1)
    if counts and count == 0:
        raise ValueError("predict: the batch is empty")
    if counts and episode_start is not None and np.size(episode_start) != count:
        raise ValueError(f"predict: episode_start of size {np.size(episode_start)}, but observations of {count}")
    if state is not None and not (isinstance(state, tuple) and len(state) == 2):
        raise TypeError(f"predict: state of type {type(state).__name__}: must be None, or what predict returned")
    remembered = None if state is None or state[1] is not None else next(tree_leaves(state[0], is_array), None)
    if counts and remembered is not None and len(remembered) != count:
        raise ValueError(f"predict: state of {len(remembered)} environments, but observations of {count}")


class TrainedPolicy:
    """A trained agent as a controller: takes the raw observation, and treats it as in training.

    Attributes:
        knows: its information set in words, for tables.
        augmentations: what is appended to its observations before they are normalized, one after another.
        flattening: what makes one vector of them after that; None where the policy takes a Dict.
    """

    def __init__(self, policy: BasePolicy, normalization: Normalization, description: dict[str, Any]) -> None:
        self.policy, self.normalization, self.description = policy, normalization, description
        self.augmentations = augmentations(description)
        self.flattening = flattening(description)
        told = "what it observes, and what the nominal model says about that"
        remembers = description.get("history") or description["algorithm"] == "recurrent_ppo"
        remembered = "what it observes and has observed in the episode" if remembers else ""
        sees = told if description.get("model_hints") else remembered or "only what it observes"
        if description.get("corrects"):
            sees += f", and {self.corrected}, which it corrects"
        self.knows = f"{sees}; {_how_trained(description.get('train') or {})}"
        self._reminder = Reminder(f"the policy of {str(description['env']).rpartition('/')[2]}")

    @property
    def corrected(self) -> str:
        """What it corrects, in words: a controller's plan, or what a controller with feedback says; "" if nothing."""
        if not self.description.get("corrects"):
            return ""
        name = self.description["corrects"]["controller"]
        has_plan = any(isinstance(one, Correction) for one in self.augmentations)
        return f"the plan of {name}" if has_plan else f"what {name} says, a controller with feedback"

    def check_environment(self, core: Core) -> None:
        """Refuse an environment that the policy would misread; one of another design is none.

        Raises:
            ValueError: mechanism, observations or actions are others than in training; the message names both.
        """
        own = gym.make(self.description["env"], **(self.description.get("options") or {}))
        there, here = _read(unwrapped(own).core), _read(core)
        if there != here:
            raise ValueError(f"made for another environment: {self.description['env']}: {there}; here: {here}")

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions for one observation or a batch, and what is to be remembered.

        Args:
            observation: of the environment, as it is, arrays of shape (n, ...) or (...).
            state: what the call before returned; None at first. An agent with a history, or one that corrects a
                controller, knows nothing of its episode without.
            episode_start: which environments begin an episode, shape (n,); by default none, but all without a state.
            deterministic: the mean action, without noise.

        Returns:
            Shape (n, action size) or (action size,), within [-1, 1]; the state, None where nothing is remembered.

        Raises:
            TypeError: the observation is no Dict, or the state none of `predict`.
            ValueError: it is of another environment, or the numbers of environments differ.
        """
        check_asked(observation, state, episode_start, self.description.get("observation_shapes") or {})
        if self.augmentations or self.description["algorithm"] == "recurrent_ppo":
            self._reminder(state)
        before, hidden = (None, None) if state is None else state
        if episode_start is not None:
            episode_start = np.reshape(episode_start, -1)  # one bool for one environment
        memories = []
        for k, augmentation in enumerate(self.augmentations):
            observation, memory = augmentation(observation, None if before is None else before[k], episode_start)
            memories.append(memory)
        seen: Any
        if self.flattening is None:
            seen = self.normalization(observation)
        else:
            seen = self.normalization.of_flat(self.flattening(observation))
        actions, hidden = self.policy.predict(seen, hidden, episode_start, deterministic)
        after: list[Any] = []
        for augmentation, memory in reversed(list(zip(self.augmentations, memories, strict=True))):
            actions = augmentation.applied(memory, actions)
            after.insert(0, augmentation.acted(memory, actions))
        return actions, (after, hidden) if after or hidden is not None else None


def _how_trained(train: Mapping[str, Any]) -> str:
    """In words, for tables."""
    means = []
    if train.get("teacher"):
        means.append("taught by a planner that knows more")
    if train.get("gradient"):
        means.append("trained by the gradient of the dynamics")
    first = train.get("gradient")
    if not first or first["timesteps"] < train["total_timesteps"]:
        means.append("trained by trial and error")
    return ", and ".join(means)


def augmentations(description: Mapping[str, Any]) -> list[Augmentation]:
    """What is appended to observations, in this order, according to the description of a policy or its training.

    Args:
        description: with "env" and "options"; "model_hints", "history" and "corrects" count.

    Raises:
        ValueError: there are no model-based features for the environment.
    """
    found: list[Augmentation] = []
    space, action_space = _spaces(description["env"], description.get("options"))
    if description.get("model_hints"):
        found.append(ModelFeatures(description["env"], description.get("options")))
        space = found[-1].space(space)
    if description.get("history"):
        found.append(History.of(int(description["history"]), space, action_space))
    if description.get("corrects"):
        # What it corrects is made for all levels at which it is trained.
        levels = description.get("levels")
        options = dict(description.get("options") or {}) | ({"level": levels} if levels else {})
        found.append(_correction(description["corrects"], description["env"], options))
    return found


def _correction(corrects: Mapping[str, Any], env_id: str, options: Mapping[str, Any] | None) -> Augmentation:
    """What corrects a plan, or a controller with feedback."""
    controller, by = controller_to_correct(str(corrects["controller"]), env_id, options), float(corrects["by"])
    return Correction(controller, by) if isinstance(controller, FullSpeedPlan) else FeedbackCorrection(controller, by)


def flattening(description: Mapping[str, Any]) -> Flattening | None:
    """What makes one vector of observations; None where the policy of this description takes a Dict.

    Args:
        description: of a policy or its training.
    """
    if description["algorithm"] != "crossq":
        return None
    return Flattening(GoalErrorExtractor(_seen_spaces(description)[0], **_extractor_kwargs(description)))


def _seen_spaces(description: Mapping[str, Any]) -> tuple[spaces.Dict, spaces.Box]:
    """The spaces of observations, with what is appended according to a description, and of actions."""
    space, action_space = _spaces(description["env"], description.get("options"))
    for augmentation in augmentations(description):
        space = augmentation.space(space)
    return space, action_space


def _extractor_kwargs(description: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "scales": tuple(description["goal_error_scales"]),
        "angles": bool(description.get("goal_is_angles", False)),
        "goal_scale": float(description.get("goal_scale", 0.5)),
    }


def policy_kwargs(description: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of the SB3 policy class.

    Args:
        description: of a policy or its training, as the JSON file has it.
    """
    algorithm = description["algorithm"]
    kwargs = {"net_arch": list(description["net_arch"]), "activation_fn": _ACTIVATIONS[description["activation"]]}
    if algorithm != "crossq":  # whose observations are flattened outside
        kwargs |= {
            "features_extractor_class": GoalErrorExtractor,
            "features_extractor_kwargs": _extractor_kwargs(description),
        }
    return kwargs | ({"lstm_hidden_size": int(description["lstm_hidden_size"])} if algorithm == "recurrent_ppo" else {})


def plain_policy(description: Mapping[str, Any]) -> Any:
    """An untrained policy of Stable-Baselines3's or sb3-contrib's class.

    Args:
        description: of a policy or its training.
    """
    flat, (space, action_space) = flattening(description), _seen_spaces(description)
    seen = space if flat is None else flat.space
    return POLICIES[description["algorithm"]](seen, action_space, lambda _: 0.0, **policy_kwargs(description))


def _is_taught_only(description: Mapping[str, Any]) -> bool:
    """Whether a teacher or the gradient of the dynamics has trained the policy all the way, so that its value function
    is that of the beginning.
    """
    train = description.get("train") or {}
    first = train.get("teacher") or train.get("gradient")
    return first is not None and first["timesteps"] >= train["total_timesteps"]


def save_policy(folder: Path, agent: TrainedPolicy, half: bool = False) -> None:
    """Write policy.safetensors and policy.json into a folder, each whole or not at all.

    Of a policy that a teacher or a gradient alone has trained, the value function, which nothing has trained, is left
    out.

    Args:
        folder: is created.
        agent: whose description has env, options, algorithm, net_arch, activation, goal_error_scales, and anything
            else worth keeping (seed, timesteps, config).
        half: round the weights to half precision, for half the size; loaded, they are single precision again.
    """
    policy, normalization, description = agent.policy, agent.normalization, agent.description
    folder.mkdir(parents=True, exist_ok=True)
    tensors = {key: value.detach().cpu().contiguous() for key, value in policy.state_dict().items()}
    if _is_taught_only(description):
        tensors = {key: value for key, value in tensors.items() if not key.startswith(_VALUE)}
    if half:
        tensors = {key: value.half() for key, value in tensors.items()}
    tensors[_NORMALIZE + "mean"] = torch.from_numpy(np.asarray(normalization.mean, np.float64))
    tensors[_NORMALIZE + "variance"] = torch.from_numpy(np.asarray(normalization.variance, np.float64))
    data = save_tensors(tensors)
    shapes = {
        key: list(space.shape or ())
        for key, space in _spaces(description["env"], description.get("options"))[0].spaces.items()
    }
    content = {
        "format": FORMAT,
        **description,
        "observation_shapes": shapes,
        "action_size": int(np.prod(policy.action_space.shape or ())),
        "normalization": {"clip": normalization.clip, "epsilon": normalization.epsilon},
        "sha256": hashlib.sha256(data).hexdigest(),
    }
    for name, written in ((WEIGHTS, data), (DESCRIPTION, json.dumps(content, indent=2).encode())):
        with written_whole(folder / name) as part:
            part.write_bytes(written)


def load_policy(
    folder: str | os.PathLike[str], env_id: str | None = None, options: Mapping[str, Any] | None = None
) -> TrainedPolicy:
    """Load a policy that `save_policy` wrote.

    Args:
        folder: the folder, or one of the two files in it.
        env_id: of the environment that it is wanted for, if that is to be checked.
        options: of that environment.

    Raises:
        PolicyFileError: a file is missing, foreign, truncated, or the two do not belong together or to this
            environment.
    """
    folder, env_id = Path(folder), None if env_id is None else full_id(env_id)
    folder = folder.parent if folder.name in (WEIGHTS, DESCRIPTION) else folder
    weights, description_file = folder / WEIGHTS, folder / DESCRIPTION
    for file in (weights, description_file):
        if not file.is_file():
            raise PolicyFileError(
                f"{folder}: no {file.name} in it; "
                f"a policy is a folder with {WEIGHTS} and {DESCRIPTION}, as `tensegrity train` writes it"
            )
    try:
        description = json.loads(description_file.read_text())
        wanted = description["env"], description["algorithm"], description["sha256"], description["format"]
        _, _, activation = (description[key] for key in ("net_arch", "goal_error_scales", "activation"))
        clip, epsilon = (float(description["normalization"][key]) for key in ("clip", "epsilon"))
        shapes, action_size = description["observation_shapes"], description["action_size"]
        trained_with = dict(description.get("options") or {})
    except (ValueError, KeyError, TypeError) as error:
        raise PolicyFileError(
            f"{description_file}: not a description of a policy of this package ({error!r})"
        ) from error
    env, algorithm, digest, version = wanted
    if version != FORMAT or algorithm not in POLICIES or activation not in _ACTIVATIONS:
        raise PolicyFileError(
            f"{description_file}: format {version!r}, algorithm {algorithm!r}, activation {activation!r}; "
            f"this package reads format {FORMAT}, {', '.join(POLICIES)}, {', '.join(_ACTIVATIONS)}"
        )
    module, colon, _ = str(env).partition(":")
    if colon and env_id != env and module not in sys.modules:
        raise PolicyFileError(
            f"{description_file}: of {env}, whose module {module} would be run: import it, or give env_id={env!r}, "
            "if you trust it"
        )
    if env_id is not None and (env != env_id or trained_with != (options or {})):
        try:
            observation_space, action_space = _spaces(env_id, options)
        except (TypeError, ValueError, gym.error.Error) as error:
            reason = str(error).split(" was raised from the environment creator")[0]
            raise PolicyFileError(f"{folder}: wanted for {env_id!r}, trained on {env!r}: {reason}") from error
        if {k: list(s.shape or ()) for k, s in observation_space.spaces.items()} != shapes or action_space.shape != (
            action_size,
        ):
            own = f" with {dict(options)}" if options else ""
            raise PolicyFileError(
                f"{folder}: trained on {env} ({shapes}, {action_size} actions), which does not fit {env_id}{own}"
            )
    data = weights.read_bytes()
    if hashlib.sha256(data).hexdigest() != digest:
        raise PolicyFileError(
            f"{weights}: truncated, or not the file that {DESCRIPTION} describes (its SHA-256 differs)"
        )
    try:
        tensors = load_tensors(data)
    except SafetensorError as error:
        raise PolicyFileError(f"{weights}: not a safetensors file ({error})") from error
    try:
        policy = plain_policy(description)
    except (KeyError, TypeError, ValueError, gym.error.Error) as error:
        raise PolicyFileError(f"{description_file}: no policy can be made of this description ({error})") from error
    try:
        mean, variance = (tensors.pop(_NORMALIZE + key).numpy() for key in ("mean", "variance"))
        fit = policy.load_state_dict(tensors, strict=not _is_taught_only(description))
        if fit.unexpected_keys or not all(key.startswith(_VALUE) for key in fit.missing_keys):
            raise KeyError(*fit.unexpected_keys, *fit.missing_keys)
    except (KeyError, RuntimeError, TypeError, ValueError, gym.error.Error) as error:
        raise PolicyFileError(
            f"{weights}: its tensors do not fit the policy that {DESCRIPTION} describes ({error})"
        ) from error
    if not all(np.isfinite(array).all() for array in (mean, variance)) or not all(
        bool(torch.isfinite(t).all()) for t in tensors.values()
    ):
        raise PolicyFileError(f"{weights}: holds numbers that are not finite")
    policy.set_training_mode(False)
    return TrainedPolicy(policy, Normalization(mean, variance, clip, epsilon), description)


def _read(core: Core) -> str:
    """What is observed and done, in words."""
    fields, actions = core.schema.fields.values(), core.simulation.action_size
    return f"{type(core.nominal).__name__}, {', '.join(field.name for field in fields)}; {actions} actions"


def _spaces(env_id: str, options: Mapping[str, Any] | None) -> tuple[spaces.Dict, spaces.Box]:
    env = gym.make(env_id, **(options or {}))
    observation_space, action_space = env.observation_space, env.action_space
    env.close()
    assert isinstance(observation_space, spaces.Dict)
    assert isinstance(action_space, spaces.Box)
    return observation_space, action_space
