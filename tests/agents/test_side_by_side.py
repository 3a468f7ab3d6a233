"""Agents trained at once in processes of their own are those trained one after another; signals and errors arrive."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from tensegrity_agents.config import Experiment
from tensegrity_agents.experiment import train_agents
from tensegrity_agents.sb3 import training
from tensegrity_agents.sb3.errors import TrainingError

TINY = {"total_timesteps": 64, "net_arch": [4], "ppo": {"num_envs": 4, "n_steps": 8}}
EXPERIMENT = Experiment(env="TwoXReach-v0", train=TINY, seeds=[0, 1, 2])


def weights(agents):
    return {seed: [value.numpy() for value in agent.policy.state_dict().values()] for seed, agent in agents.items()}


def test_they_are_the_same_agents(tmp_path):
    seen = []
    together = train_agents(EXPERIMENT, tmp_path / "two", lambda *step: seen.append(step), jobs=2)
    apart = train_agents(EXPERIMENT, tmp_path / "one", lambda *step: None)
    assert list(together) == list(apart) == [0, 1, 2]
    for seed, values in weights(apart).items():
        for ours, theirs in zip(values, weights(together)[seed], strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert {what for what, *_ in seen} == {f"training agent (seed {seed})" for seed in (0, 1, 2)}
    again = train_agents(EXPERIMENT, tmp_path / "two", lambda *step: pytest.fail("they are there"), jobs=2)
    assert list(again) == [0, 1, 2]


@pytest.mark.full
def test_one_that_fails_is_named(tmp_path):
    (tmp_path / "agent-1").write_text("a file where a folder should be")
    with pytest.raises(TrainingError, match="agent of seed 1: "):
        train_agents(EXPERIMENT, tmp_path, lambda *step: None, jobs=2)
    assert (tmp_path / "agent-2" / "policy.json").is_file()


@pytest.mark.full
def test_a_signal_leaves_checkpoints_and_the_exit_code_of_an_interrupt(tmp_path):
    config = tmp_path / "long.yaml"
    config.write_text("env: TwoXReach-v0\nseeds: [0, 1]\ntrain: {total_timesteps: 100000000}\n")
    code = "from tensegrity_agents.command import run; run()"
    words = [
        sys.executable,
        "-c",
        code,
        "train",
        "--config",
        str(config),
        "--out",
        str(tmp_path / "out"),
        "--jobs",
        "2",
    ]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    wanted = [tmp_path / "out" / f"agent-{seed}" / "tensorboard" for seed in (0, 1)]
    while not all(path.is_dir() for path in wanted):
        assert process.poll() is None
        time.sleep(0.5)
    time.sleep(2)
    os.kill(process.pid, signal.SIGTERM)
    text, _ = process.communicate()
    assert process.returncode == 143, text
    assert "run the same command again" in text
    assert all((path.parent / "checkpoint.pt").is_file() for path in wanted)


def test_what_cannot_be_trained_takes_no_agent_away(tmp_path, monkeypatch):
    kept = tmp_path / "agent-0" / "policy.json"
    kept.parent.mkdir()
    kept.touch()

    def fails(*_):
        raise ValueError("no such model")

    monkeypatch.setattr(training, "make_model", fails)
    with pytest.raises(ValueError, match="no such model"):
        train_agents(EXPERIMENT, tmp_path, lambda *step: None, fresh=True)
    assert kept.is_file()
