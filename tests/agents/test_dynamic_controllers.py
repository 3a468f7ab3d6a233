"""Analytic controllers in dynamics, and the transfer table."""

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("mujoco")

from baseline_runs import of_group, success_of
from tensegrity_agents.controllers import BASELINES, DYNAMIC, baselines_of, make_controller
from tensegrity_agents.controllers.dynamic import Feedback, Ramp
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.evaluation.transfer import Candidate, pair_of, transfer
from tensegrity_agents.experiment import candidates
from tensegrity_agents.reporting.transfer_table import transfer_to_markdown
from tensegrity_envs.seeding import VALIDATION_SEED

IDS = ("tensegrity/TwoXTensionReachMuJoCo-v0", "tensegrity/DualTriangleReachMuJoCo-v0")
LOADED = "tensegrity/DualTriangleLoadedReachMuJoCo-v0"


def success(controller, env_id, episodes=60):
    return evaluate(controller, env_id, episodes, VALIDATION_SEED, "controller").columns["success"].mean()


@pytest.mark.parametrize("env_id", IDS)
def test_ramps_reach_what_full_speed_does_not(env_id):
    name = next(name for name in DYNAMIC[gym.spec(env_id).kwargs["arm"]] if "ramp" in name)
    ramp = make_controller(name, env_id)
    assert success_of(env_id, name) >= 0.95
    core = gym.make(env_id).unwrapped.core
    plain = type(ramp.base)(core)
    assert success(plain, env_id) < 0.7


@pytest.mark.parametrize("env_id", [*IDS, "tensegrity/TwoXFastReachMuJoCo-v0"])
def test_the_settling_time_is_that_of_a_look_back(env_id):
    """The step after the last one off target, of an episode that ends on target; there success takes no hold."""
    n, steps = 8, gym.spec(env_id).max_episode_steps
    times = evaluate(make_controller("lqg", env_id), env_id, n, VALIDATION_SEED, "lqg").columns["settling_time_s"]
    envs = gym.make_vec(env_id, n, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    controller, core = make_controller("lqg", env_id), envs.unwrapped.core
    observation, info = envs.reset(seed=VALIDATION_SEED)
    state, start, off = None, np.ones(n, bool), []
    for _ in range(steps):
        off.append(info[core.error_name] > core.task.tolerance)
        action, state = controller.predict(observation, state, start, deterministic=True)
        observation, _, terminated, truncated, info = envs.step(action)
        start = terminated | truncated
        if start.any():
            assert start.all() and not terminated.any()
            break
    last = np.array(off)
    assert not last[-1].any()
    expected = 0.02 * (steps - np.argmax(last[::-1], axis=0))
    np.testing.assert_allclose(times, expected)
    assert (times < 1.5).all()


def test_nobody_asks_when_arms_at_rest_settle():
    env_id = "tensegrity/TwoXTensionReach-v0"
    columns = evaluate(make_controller("random", env_id), env_id, 4, VALIDATION_SEED, "random").columns
    assert np.isnan(columns["settling_time_s"]).all()


@of_group(LOADED)
def test_with_an_unknown_force_the_observer_wins_and_the_nominal_ramp_fails():
    found = {name: success_of(LOADED, name) for name in DYNAMIC["DualTriangleReach"]}
    assert found["observer"] >= 0.95
    assert found["oracle"] >= 0.95
    assert found["closed_form_ramp"] < 0.3
    assert found["pseudo_inverse"] > found["closed_form_ramp"]


@pytest.mark.parametrize("env_id", IDS)
def test_damping_takes_energy_out_of_the_arm(env_id):
    """The least squares inputs make the joint torques -c M velocity; checked by MuJoCo's own forces."""
    core = gym.make(env_id).unwrapped.core
    model, simulation = core.engine.model, core.simulation
    controller = Ramp(core, next(iter(BASELINES[gym.spec(env_id).kwargs["arm"]].values())))
    rng = np.random.default_rng(0)
    low, high = simulation.bounds(core.nominal)
    for _ in range(20):
        q = rng.uniform(-0.6, 0.6, core.engine.joints)
        inputs = low + (high - low) * rng.uniform(0.4, 0.6, simulation.action_size)
        velocity = rng.uniform(-0.2, 0.2, core.engine.joints)
        sensed = core.schema.decode(core_observation(core, q, inputs, velocity))
        np.testing.assert_allclose(sensed.joint_rates[0], velocity, atol=1e-6)
        np.testing.assert_allclose(sensed.inputs[0], inputs, rtol=1e-5)
        action = controller.damped(sensed, inputs[None], q[None])[0]
        assert np.abs(action).max() < 1  # else the rate would cut it
        before, after = (
            -model.energy_gradient(q, np.array(simulation.actuation(core.nominal, tuple(values))))
            for values in (inputs, inputs + simulation.rate * action)
        )
        added = after - before
        wanted = -controller.damping * model.mass_matrix(np.zeros_like(q)) @ velocity
        np.testing.assert_allclose(added, wanted, atol=2e-5 * max(1.0, np.abs(wanted).max() / 1e-3))
        assert added @ velocity < 0


def core_observation(core, q, inputs, velocity):
    """An observation, written down from the tables of docs/environments.md."""
    low, high = core.simulation.bounds(core.nominal)
    tip = np.array(core.nominal.tip(tuple(q)))
    angles = np.stack([np.sin(q), np.cos(q)], axis=1).ravel()
    rates = 0.2 * velocity / (1 + np.abs(0.2 * velocity))
    scaled = (2 * inputs - high - low) / (high - low)
    vector = np.concatenate([tip / core.reach, scaled, angles, [0.5, 0.5], rates])
    return {"observation": vector[None], "achieved_goal": tip[None], "desired_goal": tip[None]}


def test_controllers_plan_anew_when_an_episode_begins():
    env_id = IDS[1]
    envs = gym.make_vec(env_id, 4, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    for kind, base in ((Ramp, "closed_form_squares"), (Feedback, "pseudo_inverse")):
        controller = kind(envs.unwrapped.core, BASELINES["DualTriangleReach"][base])
        observation, _ = envs.reset(seed=0)
        controller.begin_episodes(np.ones(4, bool), envs.unwrapped.design)
        alone, _ = controller.predict(observation)
        first, _ = envs.reset(seed=100)
        _, memory = controller.predict(first)
        _, memory = controller.predict(first, memory, np.zeros(4, bool))
        again, _ = controller.predict(observation, memory, np.array([True, False, True, False]))
        np.testing.assert_array_equal(again[[0, 2]], alone[[0, 2]])
        assert (again[[1, 3]] != alone[[1, 3]]).any()


def test_the_transfer_table_has_every_baseline_on_both_sides(tmp_path):
    pair = pair_of("tensegrity/DualTriangleReachMuJoCo-v0")
    assert pair == pair_of("tensegrity/DualTriangleReach-v0")
    found = candidates(pair, tmp_path)
    assert {c.name for c in found if c.home == pair[0]} == set(baselines_of(pair[0])) - {"random"}
    assert {c.name for c in found if c.home == pair[1]} == set(baselines_of(pair[1])) - {"random"}
    some = [c for c in found if c.name in ("closed_form_squares", "closed_form_ramp")]
    results = transfer(pair, some, 30)
    rates = {c.name: [runs[where][0].columns["success"].mean() for where in pair] for c, runs in results}
    assert rates["closed_form_ramp"] == [1.0, 1.0]
    assert rates["closed_form_squares"][0] == 1.0
    assert rates["closed_form_squares"][1] < 0.8
    text = transfer_to_markdown(results, pair)
    assert text.count("\n") == 2 + len(some)
    assert isinstance(some[0], Candidate)
    with pytest.raises(ValueError, match="twin"):
        pair_of("tensegrity/TwoXPostureChange-v0")
