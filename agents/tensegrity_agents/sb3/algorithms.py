"""The training environments and the model of Stable-Baselines3 or sb3-contrib that a config asks for."""

from typing import Any

import gymnasium as gym
import numpy as np
from sb3_contrib import TQC, CrossQ, RecurrentPPO
from stable_baselines3 import PPO, SAC, TD3, HerReplayBuffer
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecMonitor, VecNormalize

from tensegrity_agents.config import Experiment
from tensegrity_agents.sb3.augmented import AugmentedVecEnv
from tensegrity_agents.sb3.flat import FlatVecEnv
from tensegrity_agents.sb3.levels import LevelsVecEnv
from tensegrity_agents.sb3.policy_file import POLICIES, augmentations, flattening, policy_kwargs
from tensegrity_agents.sb3.privileged import PRIVILEGED, PrivilegedExtractor, PrivilegedPolicy, PrivilegedVecEnv
from tensegrity_agents.sb3.vec_env import VectorEnvAdapter

_MODELS: dict[str, Any] = {
    "ppo": PPO,
    "recurrent_ppo": RecurrentPPO,
    "sac": SAC,
    "td3": TD3,
    "tqc": TQC,
    "crossq": CrossQ,
}


def make_environment(experiment: Experiment) -> VecNormalize:
    """The training environments, with what agents remember and are told, counted and normalized."""
    settings, options = experiment.train, experiment.training_options
    described = {"env": experiment.env, "options": experiment.options, **settings.model_dump(mode="json")}
    env = _plain(experiment, options)
    keys = ["observation"]
    if settings.privileged is not None:
        assert isinstance(env, VectorEnvAdapter | LevelsVecEnv)
        env = PrivilegedVecEnv(env)
        keys.append(PRIVILEGED)
    for augmentation in augmentations(described):
        env = AugmentedVecEnv(env, augmentation)
    flat = flattening(described)
    if flat is not None:
        return VecNormalize(VecMonitor(FlatVecEnv(env, flat)), norm_reward=False)
    return VecNormalize(VecMonitor(env), norm_obs_keys=keys, norm_reward=False)


def _plain(experiment: Experiment, options: dict[str, Any]) -> VecEnv:
    """The environments themselves."""
    settings = experiment.train
    own: dict[str, Any] = {"stagger": True, "repeat_failed": settings.repeat_failed}
    if settings.levels is not None:
        return LevelsVecEnv.make(experiment.env, settings.ppo.num_envs, settings.levels, **own, **options)
    if settings.is_on_policy:
        return VectorEnvAdapter.make(experiment.env, settings.ppo.num_envs, **own, **options)
    off = settings.off_policy
    if off.num_envs > 1:
        return VectorEnvAdapter.make(experiment.env, off.num_envs, full_info=off.her, **options)
    return DummyVecEnv([lambda: gym.make(experiment.env, **options)])


def make_model(experiment: Experiment, env: VecNormalize, seed: int) -> BaseAlgorithm:
    """The model, untrained.

    Args:
        experiment: with the settings.
        env: of `make_environment`.
        seed: of its networks and its exploration.
    """
    settings = experiment.train
    own = _on_policy(experiment) if settings.is_on_policy else _off_policy(experiment, env)
    kwargs = policy_kwargs(settings.model_dump(mode="json")) | own.pop("policy_kwargs", {})
    policy = POLICIES[settings.algorithm]
    if settings.privileged is not None:
        policy = PrivilegedPolicy
        kwargs |= {"features_extractor_class": PrivilegedExtractor, "identify": settings.privileged.identify}
        own["ent_coef"] = 1.0  # of the estimate, see PrivilegedPolicy
    algorithm = _MODELS[settings.algorithm]
    model: BaseAlgorithm = algorithm(policy, env, policy_kwargs=kwargs, seed=seed, device="cpu", **own)
    return model


def _on_policy(experiment: Experiment) -> dict[str, Any]:
    p = experiment.train.ppo
    return {
        "n_steps": p.n_steps,
        "batch_size": min(p.batch_size, p.n_steps * p.num_envs),
        "n_epochs": p.n_epochs,
        "gamma": p.gamma,
        "gae_lambda": p.gae_lambda,
        "learning_rate": p.learning_rate,
        "clip_range": p.clip_range,
        "ent_coef": p.ent_coef,
        "policy_kwargs": {"log_std_init": p.log_std_init},
    }


def _off_policy(experiment: Experiment, env: VecNormalize) -> dict[str, Any]:
    o = experiment.train.off_policy
    given: dict[str, Any] = {
        name: getattr(o, name)
        for name in (
            "learning_rate",
            "buffer_size",
            "learning_starts",
            "batch_size",
            "gamma",
            "train_freq",
            "gradient_steps",
        )
    }
    if experiment.train.algorithm != "crossq":  # which has no target networks
        given["tau"] = o.tau
    if experiment.train.algorithm == "td3":  # whose policy has no noise of its own
        size = int(np.prod(env.action_space.shape or ()))
        given["action_noise"] = NormalActionNoise(np.zeros(size), np.full(size, o.action_noise))
    if o.her:
        given["replay_buffer_class"] = HerReplayBuffer
        given["replay_buffer_kwargs"] = {
            "n_sampled_goal": o.n_sampled_goal,
            "goal_selection_strategy": "future",
            "copy_info_dict": True,
        }
    return given
