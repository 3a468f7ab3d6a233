"""Observations as one vector, for algorithms whose policies take no Dict."""

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from tensegrity_agents.sb3.features import GoalErrorExtractor


class Flattening:
    """From a Dict observation to what `GoalErrorExtractor` makes of it, which other policies do inside.

    Args:
        extractor: of the features.
    """

    def __init__(self, extractor: GoalErrorExtractor) -> None:
        self.extractor = extractor
        self.space = spaces.Box(-np.inf, np.inf, (extractor.features_dim,), np.float32)

    def __call__(self, observation: dict[str, Any]) -> np.ndarray:
        """The features of a batch, shape (n, size), or of a single observation, shape (size,)."""
        # In double precision: where a feature hardly varies, normalizing it would make much of a last digit.
        rows = {key: torch.from_numpy(np.atleast_2d(np.asarray(v, np.float64))) for key, v in observation.items()}
        with torch.no_grad():
            features: np.ndarray = self.extractor(rows).numpy().astype(np.float32)
        return features[0] if np.ndim(observation["observation"]) == 1 else features


class FlatVecEnv(VecEnvWrapper):
    """A vector environment whose observations, terminal ones included, are flattened.

    Args:
        venv: whose observations are Dicts.
        flattening: of these.
    """

    def __init__(self, venv: VecEnv, flattening: Flattening) -> None:
        self.flattening = flattening
        super().__init__(venv, flattening.space)

    def reset(self) -> VecEnvObs:
        """Begin new episodes everywhere."""
        observation: Any = self.venv.reset()
        return self.flattening(observation)

    def step_wait(self) -> VecEnvStepReturn:
        """Take the step."""
        observation: Any
        observation, reward, done, infos = self.venv.step_wait()
        for i in np.flatnonzero(done):
            infos[i]["terminal_observation"] = self.flattening(infos[i]["terminal_observation"])
        return self.flattening(observation), reward, done, infos
