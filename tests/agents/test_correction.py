"""Agents that correct a controller's plan: against the controller itself, and against episodes kept step by step."""

import json
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

import tensegrity_agents
from tensegrity_agents.config import Experiment
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.sb3.augmented import AugmentedVecEnv
from tensegrity_agents.sb3.correction import Correction, Course
from tensegrity_agents.sb3.errors import ExportError
from tensegrity_agents.sb3.policy_file import (
    Normalization,
    PolicyFileError,
    TrainedPolicy,
    augmentations,
    load_policy,
    plain_policy,
    save_policy,
)
from tensegrity_agents.sb3.vec_env import VectorEnvAdapter
from tensegrity_envs.seeding import VALIDATION_SEED

pytest.importorskip("mujoco")

FAST, TWO_X = (f"tensegrity/{name}FastReachMuJoCo-v0" for name in ("DualTriangle", "TwoX"))
PLAN, BY = "closed_form_plan", 4.0
KEYS = ("observation", "achieved_goal", "desired_goal")


def make_vec(env_id, count, **options):
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)


def described(env_id=FAST, history=2, **options) -> dict[str, Any]:
    train = {"total_timesteps": 1000, "net_arch": [8], "history": history, "corrects": {"controller": PLAN, "by": BY}}
    experiment = Experiment(env=env_id, train=train, **options)
    return {"env": env_id, "options": options, **experiment.train.model_dump(mode="json")}


def agent_of(description: dict[str, Any], scale: float) -> TrainedPolicy:
    """An agent whose outputs are of some size, or zero."""
    torch.manual_seed(0)
    policy = plain_policy(description)
    with torch.no_grad():
        policy.action_net.weight *= scale
    policy.set_training_mode(False)
    size = policy.observation_space["observation"].shape[0]
    return TrainedPolicy(policy, Normalization(np.zeros(size), np.ones(size), 10.0, 1e-8), description)


@pytest.mark.parametrize("env_id", [FAST, TWO_X])
def test_without_corrections_it_is_the_controller(env_id):
    plan, agent = make_controller(PLAN, env_id), agent_of(described(env_id), 0.0)
    envs = make_vec(env_id, 12)
    seen, _ = envs.reset(seed=VALIDATION_SEED)
    states, begins = [None, None], np.ones(12, bool)
    for _ in range(30):
        wanted, states[0] = plan.predict(seen, states[0], begins)
        given, states[1] = agent.predict(seen, states[1], begins)
        np.testing.assert_allclose(given, wanted, atol=2e-4)
        seen, _, terminated, truncated, _ = envs.step(wanted)
        begins = terminated | truncated
    runs = [evaluate(one, env_id, 6, VALIDATION_SEED, "one", "one") for one in (plan, agent)]
    np.testing.assert_array_equal(runs[0].columns["success"], runs[1].columns["success"])
    for name in ("return", "final_error_m"):
        np.testing.assert_allclose(runs[0].columns[name], runs[1].columns[name], rtol=1e-3, atol=1e-5)


def test_a_delay_does_not_ask_twice():
    """The inputs are where they were planned to be, later by the delay."""
    delay = {"actuation_delay": [2, 2]}
    agent = agent_of(described(FAST, 0, randomization=delay), 0.0)
    envs = make_vec(FAST, 8, randomization=delay)
    seen, _ = envs.reset(seed=VALIDATION_SEED)
    correction: Any = agent.augmentations[0]
    start, plan = correction.planner.decode(seen).inputs, correction.planner.plan_for(seen)
    assert np.abs(plan[:, 20] - start).max(axis=1).min() > 2 * correction.rate
    state, begins, running = None, np.ones(8, bool), np.ones(8, bool)
    for step in range(1, 21):
        action, state = agent.predict(seen, state, begins)
        seen, _, terminated, truncated, _ = envs.step(action)
        begins = np.zeros(8, bool)
        running &= ~(terminated | truncated)
        expected, inputs = start if step < 3 else plan[:, step - 3], correction.planner.decode(seen).inputs
        np.testing.assert_allclose(inputs[running], expected[running], atol=1e-3 * correction.rate)
    assert running.sum() >= 4


class Dictated:
    """A policy that does what it is told to, and keeps what it is shown."""

    def __init__(self, corrections: Any) -> None:
        self.corrections, self.shown = corrections, []

    def predict(self, seen, hidden, begins, deterministic):
        self.shown.append(seen["observation"])
        return self.corrections[len(self.shown) - 1], hidden


def test_agents_are_shown_the_same_in_training_and_after():
    """By the wrappers of training and by `predict`, which remembers for itself; terminal observations too."""
    n, steps = 6, 24
    description = described()
    envs: Any = VectorEnvAdapter(make_vec(FAST, n, max_episode_steps=7))
    for one in augmentations(description):
        envs = AugmentedVecEnv(envs, one)
    twin = VectorEnvAdapter(make_vec(FAST, n, max_episode_steps=7))
    corrections = np.random.default_rng(0).uniform(-1, 1, (steps, n, 3)).astype(np.float32)
    agent = agent_of(description, 1.0)
    size = envs.observation_space["observation"].shape[0]
    agent.policy, agent.normalization = Dictated(corrections), Normalization(np.zeros(size), np.ones(size), np.inf, 0.0)
    correction: Any = agent.augmentations[-1]
    envs.seed(1)
    twin.seed(1)
    told, plain = envs.reset(), twin.reset()
    state, begins, ends = None, np.ones(n, bool), 0
    for step in range(steps):
        actions, state = agent.predict(plain, state, begins)
        np.testing.assert_allclose(told["observation"], agent.policy.shown[-1], atol=1e-5)
        told, _, begins, infos = envs.step(corrections[step])
        plain, _, _, _ = twin.step(actions)
        np.testing.assert_allclose(told["observation"][:, : plain["observation"].shape[1]], plain["observation"])
        expected = correction.shown(np, state[0][-1])
        for i in np.flatnonzero(begins):
            np.testing.assert_allclose(infos[i]["terminal_observation"]["observation"][-9:], expected[i], atol=1e-5)
            ends += 1
    assert ends >= 2 * n


def test_corrections_are_steps_of_the_rate_from_the_plan():
    """By hand, and with NumPy as with Torch."""
    correction = Correction(make_controller(PLAN, FAST), BY)
    rng, rate = np.random.default_rng(0), correction.rate
    middle = 0.5 * (correction.low + correction.high)
    plan = (middle + rate * rng.uniform(-9, 9, (5, 40, 3))).astype(np.float32)
    command = (middle + rate * rng.uniform(-9, 9, (5, 3))).astype(np.float32)
    course = Course(plan, command, np.array([0, 3, 38, 39, 60]))
    asked = rng.uniform(-1, 1, (5, 3)).astype(np.float32)
    now, later = (plan[range(5), [min(step + ahead, 39) for step in course.step]] for ahead in (0, 2))
    shown = [np.clip((part - command) / rate / 3, -3, 3) for part in (now, later)]
    shown.append((plan[:, -1] - command) / rate / 10)
    np.testing.assert_allclose(correction.shown(np, course), np.concatenate(shown, axis=1), rtol=1e-5)
    actions = correction.action(np, course, asked)
    np.testing.assert_allclose(actions, np.clip((now - command) / rate + 4 * asked, -1, 1), atol=1e-5)
    after = correction.after(np, course, actions)
    np.testing.assert_allclose(after.command, command + rate * actions, rtol=1e-6)
    np.testing.assert_array_equal(after.step, course.step + 1)
    at_edge = correction.after(
        np, course._replace(command=np.full((5, 3), correction.high, np.float32)), np.ones((5, 3))
    )
    assert at_edge.command.max() == pytest.approx(correction.high)

    other = Course(*(torch.from_numpy(part) for part in course))
    for name, more in (("shown", ()), ("action", (asked,))):
        expected = getattr(correction, name)(np, course, *more)
        found = getattr(correction, name)(torch, other, *map(torch.from_numpy, more))
        np.testing.assert_allclose(found.numpy(), expected, atol=1e-6)
    found = correction.after(torch, other, torch.from_numpy(actions))
    for one, expected in zip(found, after, strict=True):
        np.testing.assert_allclose(one.numpy(), expected, rtol=1e-6)


def test_plans_are_corrected_to_their_ends():
    """Those to the far targets of the 2-X, in up to 48 steps, as others."""
    planner = make_controller(PLAN, TWO_X)
    seen, _ = make_vec(TWO_X, 64).reset(seed=VALIDATION_SEED)
    plan = planner.plan_for(seen)
    still = np.abs(plan - plan[:, -1:]).max(axis=2) < 1e-9
    assert still.argmax(axis=1).max() > 40
    np.testing.assert_allclose(Correction(planner, BY).begun(seen).plan, plan, rtol=1e-5)


def test_one_episode_or_many_and_a_policy_that_was_stored(tmp_path):
    agent = agent_of(described(), 30.0)
    save_policy(tmp_path, agent)
    loaded = load_policy(tmp_path, FAST)
    assert f"the plan of {PLAN}, which it corrects" in loaded.knows
    envs = make_vec(FAST, 3)
    seen, _ = envs.reset(seed=1)
    states: list[Any] = [None] * 5
    begins = np.ones(3, bool)
    for _ in range(12):
        ours, states[0] = agent.predict(seen, states[0], begins)
        again, states[1] = loaded.predict(seen, states[1], begins)
        np.testing.assert_array_equal(ours, again)
        for i in range(3):
            alone = {key: seen[key][i] for key in KEYS}
            action, states[2 + i] = loaded.predict(alone, states[2 + i], begins[i : i + 1])
            assert action.shape == (3,)
            np.testing.assert_allclose(action, ours[i], atol=1e-5)
        seen, _, terminated, truncated, _ = envs.step(ours)
        begins = terminated | truncated
    assert np.abs(ours).max() > 0.01


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"env": "nowhere:Arm-v0"}, "whose module nowhere would be run"),
        ({"corrects": {"controller": "nobody", "by": 1.0}}, "policy.json: no policy can be made .*'nobody' of"),
    ],
)
def test_a_description_that_was_changed_is_explained(change, match, tmp_path):
    save_policy(tmp_path, agent_of(described(), 0.0))
    file = tmp_path / "policy.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    with pytest.raises(PolicyFileError, match=match):
        load_policy(tmp_path)


def test_no_file_of_onnx_holds_a_plan(tmp_path):
    with pytest.raises(ExportError, match=r"corrects the plan of closed_form_plan.*load_policy\(folder\)\.predict"):
        tensegrity_agents.export(agent_of(described(), 1.0), tmp_path / "policy.onnx")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("env_id", "train", "match"),
    [
        (
            FAST,
            {"corrects": {"controller": "closed_form_ramp"}},
            "corrects.controller: 'closed_form_ramp' of .* cannot be corrected; closed_form_plan can",
        ),
        (FAST, {"corrects": {"controller": "nobody"}}, "corrects.controller: .nobody. of .*closed_form_plan can"),
        (FAST, {"corrects": {"controller": PLAN, "by": 0}}, "by"),
        (FAST, {"corrects": {"controller": PLAN, "by": True}}, "by"),
        (FAST, {"corrects": {"controller": PLAN, "by": 1e39}}, "by"),
        (FAST, {"corrects": {"controler": PLAN}}, "did you mean 'controller'"),
        (FAST, {"corrects": {"controller": PLAN}, "algorithm": "sac"}, "corrects: needs algorithm: ppo"),
        (
            "tensegrity/ThreeXReach-v0",
            {"corrects": {"controller": "oracle"}},
            "corrects.controller: 'oracle' of .* cannot be corrected; no controller of this id can",
        ),
    ],
)
def test_what_cannot_be_corrected_is_explained(env_id, train, match, tmp_path):
    from tensegrity_agents.config import ConfigError, load_experiment

    text = {"env": env_id, "train": {"total_timesteps": 1000} | train}
    (tmp_path / "config.yaml").write_text(__import__("yaml").safe_dump(text))
    with pytest.raises(ConfigError, match=match):
        load_experiment(tmp_path / "config.yaml")
