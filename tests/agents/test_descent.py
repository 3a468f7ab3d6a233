"""Training through the gradient of the dynamics: gradients against differences, and trainings that are interrupted."""

import sys
from typing import Any

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

pytest.importorskip("jax")
pytest.importorskip("mujoco")

from tensegrity_agents.command.program import app
from tensegrity_agents.config import ConfigError, Experiment, load_experiment
from tensegrity_agents.sb3 import descent as module
from tensegrity_agents.sb3.algorithms import make_environment, make_model
from tensegrity_agents.sb3.checkpoint import with_later_settings
from tensegrity_agents.sb3.descent import Descent
from tensegrity_agents.sb3.policy_file import load_policy
from tensegrity_agents.sb3.smooth_episodes import SmoothEpisodes
from tensegrity_agents.sb3.training import train

FAST = "tensegrity/DualTriangleFastReachMuJoCo-v0"
LOADED = "tensegrity/DualTriangleLoadedReachUncertain-v0"
ROUND = 8 * 6  # steps
_made: dict[Any, SmoothEpisodes] = {}


@pytest.fixture(autouse=True)
def _compiled_once(monkeypatch):
    """JAX compiles a step once for these tests."""

    def made(core, n, substeps, most_sensitive):
        key = core.fingerprint, n, substeps
        if key not in _made:
            _made[key] = SmoothEpisodes(core, n, substeps)
        _made[key].most_sensitive = most_sensitive
        return _made[key]

    monkeypatch.setattr(module, "SmoothEpisodes", made)


def small(rounds=4, **changes):
    gradient = {"timesteps": rounds * ROUND, "num_envs": 8, "horizon": 6, "substeps": 2}
    settings = {
        "total_timesteps": rounds * ROUND,
        "net_arch": [16],
        "history": 2,
        "corrects": {"controller": "closed_form_plan"},
        "gradient": gradient | changes.pop("gradient", {}),
        "levels": [3],
        "ppo": {"num_envs": 8, "n_steps": 4, "batch_size": 16},
    }
    return Experiment(env=changes.pop("env", FAST), train=settings | changes)


VARIANTS = {
    "plan": {},
    "settling": {"gradient": {"settling": 0.5}, "repeat_failed": 0.5},
    "feedback": {"env": LOADED, "corrects": {"controller": "servo", "by": 1.0}, "repeat_failed": 0.9},
}


def begun(experiment, seed=0):
    env = make_environment(experiment)
    found = Descent(experiment, make_model(experiment, env, seed), env, seed)
    found.begin()
    return found


def numbers(agent):
    return {name: value.numpy() for name, value in agent.policy.state_dict().items()}


class _Stopped(Exception):
    pass


@pytest.mark.parametrize(
    ("variant", "after"), [("plan", 0), ("plan", 1), ("plan", 3), ("settling", 1), ("feedback", 3)]
)
def test_an_interrupted_training_goes_on_to_the_same(variant, after, tmp_path, monkeypatch):
    experiment = small(**VARIANTS[variant])
    whole = train(experiment, 0, tmp_path / "whole")
    give = Descent.give

    def until(self):
        if self.round == after:
            raise _Stopped
        give(self)

    monkeypatch.setattr(Descent, "give", until)
    with pytest.raises(_Stopped):
        train(experiment, 0, tmp_path / "parts", checkpoint_seconds=0.0)
    monkeypatch.setattr(Descent, "give", give)
    rounds = []
    monkeypatch.setattr(Descent, "give", lambda self: (rounds.append(self.round), give(self)))
    parts = train(experiment, 0, tmp_path / "parts")
    assert rounds == list(range(after, 4))
    for name, value in numbers(whole).items():
        np.testing.assert_array_equal(numbers(parts)[name], value)
    np.testing.assert_array_equal(parts.normalization.mean, whole.normalization.mean)
    loaded = load_policy(tmp_path / "parts", experiment.env)
    assert loaded.description["timesteps"] == 4 * ROUND
    assert "trained by the gradient of the dynamics" in loaded.knows
    assert "trial and error" not in loaded.knows


def test_clipped_numbers_have_a_gradient_where_it_leads_back():
    values = torch.tensor([-2.0, -2.0, 0.5, 2.0, 2.0], requires_grad=True)
    clipped = module.returning(values, -1.0, 1.0)
    np.testing.assert_array_equal(clipped.detach().numpy(), [-1.0, -1.0, 0.5, 1.0, 1.0])
    (clipped * torch.tensor([3.0, -3.0, 3.0, 3.0, -3.0])).sum().backward()  # a step goes against this
    np.testing.assert_array_equal(values.grad.numpy(), [0.0, -3.0, 3.0, 3.0, 0.0])


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_gradient_is_that_of_the_loss(variant, monkeypatch):
    """Against differences, which float32 makes rough, along each tensor's own gradient and in another direction.

    Numbers are clipped as usual: at their bounds the gradient of a training is none of the loss.
    """
    monkeypatch.setattr(module, "returning", lambda values, low, high: values.clamp(low, high))
    changes = dict(VARIANTS[variant])
    exact = changes.pop("gradient", {}) | {"most_sensitive": None}
    descent = begun(small(**changes, gradient=exact))
    for _ in range(2):
        descent.give()
    descent.repeats = 0.0  # the same episodes every time
    loss, *_ = descent._loss(descent._begun())
    gradients = torch.autograd.grad(loss, descent.parameters)
    rng = torch.Generator().manual_seed(0)
    checked = 0
    for parameter, gradient in zip(descent.parameters, gradients, strict=True):
        for way in (gradient, gradient + 0.5 * gradient.norm() * torch.randn(gradient.shape, generator=rng)):
            if float(gradient.norm()) < 0.02:
                continue
            unit = way / way.norm()
            h, ends = 0.003, []
            before = parameter.detach().clone()
            for sign in (1.0, -1.0):
                with torch.no_grad():
                    parameter.copy_(before + sign * h * unit)
                    ends.append(float(descent._loss(descent._begun())[0]))
            with torch.no_grad():
                parameter.copy_(before)
            slope = float((gradient * unit).sum())
            assert (ends[0] - ends[1]) / (2 * h) == pytest.approx(slope, rel=0.05, abs=3e-3)
            checked += 1
    assert checked >= 4


def test_rounds_lower_the_loss():
    """Of an agent that has a wrong opinion, which it is to lose."""
    descent = begun(small(24, gradient={"learning_rate": 0.03}))
    with torch.no_grad():
        descent.model.policy.action_net.bias += 0.3
    before = _of_first_episodes(descent)
    for _ in range(24):
        descent.give()
    assert _of_first_episodes(descent) < before
    assert descent.model.num_timesteps == 24 * ROUND
    assert 0.0 <= descent.success <= 1.0


def _of_first_episodes(descent):
    latest, descent.round = descent.round, 0
    with torch.no_grad():
        loss = float(descent._loss(descent._begun())[0])
    descent.round = latest
    return loss


def test_a_share_of_the_cost_is_that_of_the_largest_error_to_come():
    descent = begun(small(gradient={"settling": 0.25}))
    errors = torch.rand((7, 5), generator=torch.Generator().manual_seed(0)) * 3 * descent.tolerance
    cost = descent._cost_of(errors)
    for step, episode in np.ndindex(7, 5):
        now, r = (
            float(descent._cost(errors[step, episode])),
            float(errors[step:, episode].max() / descent.tolerance) ** 4,
        )
        worst = r / (1 + r) + np.log(1 + r) / 10
        assert float(cost[step, episode]) == pytest.approx(0.75 * now + 0.25 * worst, rel=1e-5)


def test_episodes_that_missed_are_begun_again():
    descent = begun(small(repeat_failed=0.75))
    descent.round, descent.missed = 3, np.arange(100, 108)
    numbers = descent._begun().numbers
    again = np.intersect1d(numbers, np.arange(100, 108))
    assert 3 <= len(again) <= 8
    np.testing.assert_array_equal(numbers[len(again) :], 3 * 8 + np.arange(8 - len(again)))
    descent.give()
    kept = np.flatnonzero(np.isin(numbers, descent.missed))
    assert len(descent.missed) == round(8 * (1 - descent.success)) == len(kept)


def test_ppo_goes_on(tmp_path):
    """Its value function has been trained then, and is stored."""
    experiment = small(2, total_timesteps=3 * ROUND)
    shown = []
    agent = train(experiment, 0, tmp_path, lambda done, total, success: shown.append((done, total)))
    assert agent.description["timesteps"] >= 3 * ROUND
    assert "gradient of the dynamics, and trained by trial and error" in agent.knows
    assert shown[0] == (0, 3 * ROUND)
    assert all(done <= 3 * ROUND for done, _ in shown)
    assert shown[-1] == (3 * ROUND, 3 * ROUND)
    load_policy(tmp_path, FAST)


@pytest.mark.parametrize(
    ("env_id", "train", "match"),
    [
        (
            "tensegrity/TwoXReach-v0",
            {"gradient": {"timesteps": 100}},
            "gradient: only quasi-static environments that are",
        ),
        ("tensegrity/PlanarFourBarReachMuJoCo-v0", {"gradient": {"timesteps": 100}}, "gradient: .*prismatic actuators"),
        (FAST, {"gradient": {"timesteps": 2000}}, "gradient.timesteps .*: at most total_timesteps, 1000"),
        (FAST, {"gradient": {"timesteps": 100}, "teacher": {"timesteps": 100}}, "gradient: .*without teacher"),
        (FAST, {"gradient": {"timesteps": 100}, "privileged": {"identify": 0.5}}, "gradient: .*without .*privileged"),
        (FAST, {"gradient": {"timesteps": 100}, "algorithm": "recurrent_ppo"}, "gradient: needs algorithm: ppo"),
        (FAST, {"gradient": {"timesteps": 100}, "goal_is_angles": True}, "gradient: does not go with"),
        (FAST, {"gradient": {"timesteps": 100, "horizont": 5}}, "did you mean 'horizon'"),
        (FAST, {"gradient": {"timesteps": 100, "horizon": 1}}, "horizon"),
        (FAST, {"gradient": {"timesteps": 100, "horizon": 151}}, "gradient.horizon 151: an episode has 150 steps"),
        (FAST, {"gradient": {"timesteps": 100, "num_envs": 10**12}}, "num_envs"),
    ],
)
def test_what_does_not_fit_is_explained(env_id, train, match, tmp_path):
    text = {"env": env_id, "train": {"total_timesteps": 1000} | train}
    (tmp_path / "config.yaml").write_text(__import__("yaml").safe_dump(text))
    with pytest.raises(ConfigError, match=match):
        load_experiment(tmp_path / "config.yaml")


def test_the_command_says_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "jax", None)  # an import of it fails
    monkeypatch.setattr(module, "SmoothEpisodes", SmoothEpisodes)
    text = small().model_dump(mode="json", exclude_unset=True)
    (tmp_path / "config.yaml").write_text(__import__("yaml").safe_dump(text))
    words = ["train", "--config", str(tmp_path / "config.yaml"), "--seeds", "0", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, words, env={"COLUMNS": "300"})
    assert result.exit_code == 2, result.output
    assert "training through the gradient of the dynamics needs" in result.output
    assert "tensegrity-envs[jax]" in result.output
    assert "Traceback" not in result.output


def test_settings_of_the_gradient_that_came_later_had_their_default():
    now = small().train.model_dump(mode="json")
    before = now | {"gradient": {key: now["gradient"][key] for key in ("timesteps", "num_envs", "horizon", "substeps")}}
    assert with_later_settings(before, now) == now
    assert with_later_settings(before | {"history": 5}, now) != now
