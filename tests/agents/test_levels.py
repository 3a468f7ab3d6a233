"""Training at several levels: each environment is that of its level, bit for bit, and what stops goes on the same."""

import signal

import numpy as np
import pytest
import torch

from tensegrity_agents.config import Experiment
from tensegrity_agents.sb3.levels import LevelsVecEnv
from tensegrity_agents.sb3.training import TrainingInterruptedError, train
from tensegrity_agents.sb3.vec_env import VectorEnvAdapter
from tensegrity_envs.uncertainty import LEVELS

ENV = "tensegrity/TwoXTensionReachUncertain-v0"


def test_every_environment_is_that_of_its_level():
    several = LevelsVecEnv.make(ENV, 10, [0, 3, 2], max_episode_steps=6)
    alone = [VectorEnvAdapter.make(ENV, n, level=k, max_episode_steps=6) for n, k in ((4, 0), (3, 3), (3, 2))]
    several.seed(50)
    for adapter, first in zip(alone, (50, 54, 57), strict=True):
        adapter.seed(first)
    told = several.reset()
    expected = [adapter.reset() for adapter in alone]
    rng, delays = np.random.default_rng(0), []
    for _ in range(15):
        for key in told:
            np.testing.assert_array_equal(told[key], np.concatenate([one[key] for one in expected]))
        actions = rng.uniform(-1, 1, (10, 4)).astype(np.float32)
        told, rewards, dones, infos = several.step(actions)
        steps = [a.step(own) for a, own in zip(alone, np.split(actions, [4, 7]), strict=True)]
        expected = [step[0] for step in steps]
        np.testing.assert_array_equal(rewards, np.concatenate([step[1] for step in steps]))
        np.testing.assert_array_equal(dones, np.concatenate([step[2] for step in steps]))
        delays += [infos[i].get("random_actuation_delay", 0) for i in range(4, 7) if dones[i]]
    assert len(infos) == 10
    assert max(delays) > LEVELS[2]["actuation_delay"][1]  # level 3 is there


def small(**changes):
    settings = {
        "total_timesteps": 4096,
        "net_arch": [16],
        "history": 2,
        "levels": [0, 2, 3],
        "teacher": {"controller": "careful_oracle", "timesteps": 2048, "n_steps": 8, "gradient_steps": 4},
        "ppo": {"num_envs": 32, "n_steps": 8, "batch_size": 64, "n_epochs": 1},
    }
    return Experiment(env=ENV, train=settings | changes)


def test_what_was_stopped_goes_on_as_if_it_had_not_been(tmp_path, monkeypatch):
    """While it is taught, and after: the same policy to the bit."""
    whole = train(small(), 0, tmp_path / "whole").policy.state_dict()
    steps, step_wait = 0, LevelsVecEnv.step_wait

    def stopping(self):
        nonlocal steps
        steps += 1
        if steps in (20, 90):
            signal.raise_signal(signal.SIGTERM)
        return step_wait(self)

    monkeypatch.setattr(LevelsVecEnv, "step_wait", stopping)
    for _ in range(2):
        with pytest.raises(TrainingInterruptedError):
            train(small(), 0, tmp_path / "parts")
    parts = train(small(), 0, tmp_path / "parts").policy.state_dict()
    assert all(torch.equal(whole[name], parts[name]) for name in whole)


@pytest.mark.parametrize(
    ("env_id", "changes", "match"),
    [
        (ENV, {"levels": [0, 4]}, "from 0"),
        (ENV, {"levels": [1, 1]}, "must be different"),
        (ENV, {"levels": [0, 1], "algorithm": "sac"}, "needs algorithm: ppo"),
    ],
)
def test_levels_that_do_not_fit_are_explained(env_id, changes, match):
    with pytest.raises(ValueError, match=match):
        Experiment(env=env_id, train={"total_timesteps": 100} | changes)
