"""Environments of users, with baselines of their own, without an edit of the package."""

import json
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import pytest
from typer.testing import CliRunner

from tensegrity_agents.command.program import app
from tensegrity_agents.config import ConfigError, Experiment, known_env
from tensegrity_agents.controllers import baselines_of, register_baselines
from tensegrity_agents.experiment import compare

ROOT = Path(__file__).parents[2]
MODULE = """
import gymnasium as gym
import numpy as np

from tensegrity_agents.controllers import register_baselines
from tensegrity_agents.controllers.base import AnalyticController
from tensegrity_agents.controllers.two_x import ClosedFormIK
from tensegrity_envs.environments import TwoXReach


class SlowReach(TwoXReach):
    pass


class Still(AnalyticController):
    knows = "nothing; stays where it is"

    def initial(self, observed, index):
        return (np.zeros(len(index)),)

    def _act(self, observed, memory):
        return np.zeros((len(observed), 2)), memory


gym.register(
    "mine/{name}-v0",
    entry_point="tensegrity_envs.env:ManipulatorEnv",
    vector_entry_point="tensegrity_envs.vector_env:ManipulatorVectorEnv",
    max_episode_steps=40,
    kwargs={{"arm": SlowReach, "control": "joint"}},
)
register_baselines("mine/{name}-v0", {{"still": Still, "closed_form_ik": ClosedFormIK}})
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Writes a module that registers an environment into the working directory; returns its name and id."""
    monkeypatch.chdir(tmp_path)

    def write(name):
        (tmp_path / f"{name}.py").write_text(MODULE.format(name=name))
        return f"{name}:mine/{name}-v0"

    return write


def test_the_command_scores_the_baselines_of_an_own_environment(module, tmp_path):
    name = module("ElbowOne")
    script = ROOT / "scripts" / "evaluate.py"
    options = ["--env", name, "--controller", "still", "--controller", "closed_form_ik", "--episodes", "20"]
    shown = subprocess.run(
        [sys.executable, script, *options], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert shown.returncode == 0, shown.stderr + shown.stdout
    assert "still" in shown.stdout
    assert "closed_form_ik" in shown.stdout


def test_list_knows_the_config_and_names_the_commands_that_work(module, tmp_path):
    name = module("ElbowFour")
    shown = CliRunner().invoke(app, ["list", name])
    assert shown.exit_code == 0 and f"tensegrity compare {name}" in shown.output
    assert not json.loads(CliRunner().invoke(app, ["list", name, "--json"]).output)["config"]
    (tmp_path / "configs").mkdir()
    (tmp_path / "configs" / "elbow.yaml").write_text(f"env: {name}\n")
    assert json.loads(CliRunner().invoke(app, ["list", name, "--json"]).output)["config"]


def test_compare_trains_reports_and_lists_them(module, tmp_path):
    train = {"total_timesteps": 256, "ppo": {"num_envs": 16, "n_steps": 8, "batch_size": 64, "n_epochs": 1}}
    experiment = Experiment(env=module("ElbowTwo"), train=train, episodes=10)
    assert experiment.env == "mine/ElbowTwo-v0"
    assert experiment.compared == ["still", "closed_form_ik", "random"]
    assert experiment.results_name == "ElbowTwo-v0"
    found = compare(experiment, tmp_path / "results", lambda *step: None)
    rates = {row["controller"]: row["success"] for row in found.rows}
    assert rates["still"] == 0
    assert rates["closed_form_ik"] == 1
    assert "ElbowTwo-v0" in found.report.read_text()


def test_slips_are_told(module, tmp_path):
    (tmp_path / "broken_module.py").write_text("1 / 0")
    module("ElbowThree")
    for name, message in (
        ("no_such_module:mine/A-v0", "no_such_module"),
        ("broken_module:mine/A-v0", "ZeroDivisionError"),
        ("ElbowThree:mine/B-v0", "registers no 'mine/B-v0'"),
        ("ElbowThree:CartPole-v1", "not made of a Core"),
        ("CartPole-v1", "module:id"),
    ):
        with pytest.raises(ConfigError, match=message):
            known_env(name)
    for bad in ("", "random", "a:b"):
        with pytest.raises(ValueError, match="without a colon"):
            register_baselines("tensegrity/TwoXReach-v0", {bad: lambda core: None})
    assert "a:b" not in baselines_of("tensegrity/TwoXReach-v0")
    assert "mine/ElbowThree-v0" in gym.registry
