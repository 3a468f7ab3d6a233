"""LQG under a hidden load: what the first look tells, what the filter finds, and that it reaches."""

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("mujoco")

from baseline_runs import columns_of
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.controllers.dual_triangle.loaded_filter import loaded_postures
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_envs.seeding import VALIDATION_SEED

NOMINAL, UNCERTAIN = (f"tensegrity/DualTriangleLoadedReach{kind}MuJoCo-v0" for kind in ("", "Uncertain"))


def begun(env_id, n, seed, **options):
    envs = gym.make_vec(env_id, n, vectorization_mode="vector_entry_point", **options)
    observation, info = envs.reset(seed=seed)
    controller = make_controller("lqg", env_id, options)
    controller.begin_episodes(np.ones(n, bool), envs.unwrapped.design, None)
    return envs, controller, observation, info


def test_loaded_postures_are_in_equilibrium_and_those_of_the_episodes():
    _, controller, _, info = begun(NOMINAL, 20, 3)
    arm, inputs = controller.nominal, info["control_inputs"]
    found = loaded_postures(arm, inputs, info["load"])
    torque = arm.energy_gradient(tuple(found.T), arm.free_lengths(tuple(inputs.T)), tuple(info["load"].T))
    assert np.abs(torque).max() < 1e-8
    np.testing.assert_allclose(found, info["configuration"], atol=1e-6)


@pytest.mark.parametrize("level", [1, 2, 3])
def test_the_first_belief_is_as_wrong_as_it_says(level):
    """Loads are drawn from its prior: squared errors, in units of its covariance, are 2 in the mean."""
    _, controller, observation, info = begun(UNCERTAIN, 60, 7, level=level)
    belief = controller.filter.first(controller.decode(observation))
    off = belief.mean[:, -2:] - info["load"]
    squared = np.einsum("ni,nij,nj->n", off, np.linalg.inv(belief.covariance[:, -2:, -2:]), off)
    assert 0.8 < squared.mean() < 4
    spread = np.sqrt(np.trace(belief.covariance[:, -2:, -2:], axis1=1, axis2=2))
    assert np.median(spread) < 0.3 * controller.filter.largest_load  # it tells more than the prior


def test_the_load_of_a_nominal_arm_without_noise_is_found():
    envs, controller, observation, info = begun(NOMINAL, 6, 11)
    memory = None
    for _ in range(60):
        begins = np.full(6, memory is None)
        action, memory = controller.predict(observation, memory, begins)
        observation, _, terminated, _, info = envs.step(action.astype(np.float32))
        assert not terminated.any()
    np.testing.assert_allclose(memory.belief.mean[:, -2:], info["load"], atol=0.01 * controller.filter.largest_load)
    np.testing.assert_allclose(memory.belief.mean[:, :3], info["configuration"], atol=0.02)


def test_derivatives_of_what_is_seen_of_the_tip():
    _, controller, observation, _ = begun(UNCERTAIN, 3, 5, level=2)
    observed = controller.decode(observation)
    mean = controller.filter.first(observed).mean
    mean[:, 3:6] = np.random.default_rng(0).normal(size=(3, 3))
    off, slopes, _ = controller.filter._tip_seen(mean, observed)
    for j, step in enumerate(1e-6 * np.eye(mean.shape[1])):
        moved = controller.filter._tip_seen(mean + step, observed)[0]
        np.testing.assert_allclose((off - moved) / 1e-6, slopes[:, :, j], atol=1e-3)


def test_it_reaches_under_a_hidden_load():
    assert columns_of(NOMINAL, "lqg")["success"].mean() >= 0.95


@pytest.mark.full
@pytest.mark.parametrize("level", [2, 3])
def test_it_holds_under_uncertainty(level):
    options = {"level": level}
    controller = make_controller("lqg", UNCERTAIN, options)
    columns = evaluate(controller, UNCERTAIN, 40, VALIDATION_SEED, "lqg", env_options=options).columns
    assert columns["success"].mean() >= 0.9
