"""Controllers of prismatic actuators in dynamics: what shaping and damping are worth, and by which physics."""

import gymnasium as gym
import numpy as np
import pytest

from baseline_runs import columns_of, of_group

pytest.importorskip("mujoco")

import tensegrity_envs
from tensegrity_agents.controllers import BASELINES, DYNAMIC, planar_four_bar
from tensegrity_agents.controllers.fixed_length_damping import Damping
from tensegrity_agents.controllers.planar_four_bar.dynamic import PlannedPath
from tensegrity_agents.controllers.planar_four_bar.modes import FourBarModes
from tensegrity_agents.controllers.spatial_prism.modes import PrismModes
from tensegrity_agents.evaluation.transfer import pair_of

FOUR_BAR, PRISM = "tensegrity/PlanarFourBarReachMuJoCo-v0", "tensegrity/SpatialPrismTrackMuJoCo-v0"


@of_group(FOUR_BAR)
def test_damping_and_shaping_leave_less_vibration_in_the_four_bar():
    found = {name: columns_of(FOUR_BAR, name) for name in DYNAMIC["PlanarFourBarReach"]}
    error = {name: np.median(c["final_error_m"]) for name, c in found.items()}
    success = {name: c["success"].mean() for name, c in found.items()}
    assert success["closed_form_ramp"] >= 0.98
    assert success["closed_form_ik"] > 0.8
    assert success["pseudo_inverse"] > 0.4
    assert error["closed_form_shaped"] < 0.5 * error["closed_form_ik"]
    assert error["closed_form_damped"] < 0.01 * error["closed_form_ik"]


@of_group(PRISM)
@pytest.mark.parametrize("name", [name for name in DYNAMIC["SpatialPrismTrack"] if name != "oracle"])
def test_the_prism_stays_on_its_curve(name):
    assert columns_of(PRISM, name)["success"].all()


def test_damping_halves_the_error_after_the_start_of_the_prism():
    errors = {}
    for name in ("closed_form_ik", "closed_form_damped"):
        envs = gym.make_vec(
            PRISM,
            20,
            vectorization_mode="vector_entry_point",
            autoreset_mode="SameStep",
            dynamics={"joint_damping": 0.005},
        )
        controller = DYNAMIC["SpatialPrismTrack"][name](envs.unwrapped.core)
        observation, _ = envs.reset(seed=1)
        controller.begin_episodes(np.ones(20, bool), envs.unwrapped.design)
        state, start, errors[name] = None, np.ones(20, bool), []
        for _ in range(60):
            action, state = controller.predict(observation, state, start)
            start = np.zeros(20, bool)
            observation, *_ = envs.step(action)
            way = observation["achieved_goal"] - observation["desired_goal"]
            errors[name].append(np.linalg.norm(way, axis=1).mean())
    assert np.mean(errors["closed_form_damped"]) < 0.5 * np.mean(errors["closed_form_ik"])


@pytest.mark.parametrize("env_id", [FOUR_BAR, PRISM])
def test_the_linear_model_predicts_a_step_of_the_simulation(env_id):
    """Small deviations of the lengths, from rest: MuJoCo finds the elastic motion that the regulator expects."""
    fine = {
        "joint_damping": 0.0,
        "timestep": 0.0005,
        "servo_time": 0.0003,
        "frame_skip": 200 if env_id == FOUR_BAR else 100,
    }
    env = gym.make(env_id, dynamics=fine).unwrapped
    modes = (FourBarModes if env_id == FOUR_BAR else PrismModes)(env.core)
    damper = Damping(env.core, modes)
    for seed in range(5):
        env.reset(seed=seed)
        lengths = np.array(env._state.inputs)[None]
        observation = {key: value[None] for key, value in env._observation().items()}
        away, rate, branch = modes.read(env.core.schema.decode(observation), lengths)
        np.testing.assert_allclose(away, 0, atol=1e-5)
        np.testing.assert_allclose(rate, 0, atol=1e-9)
        jump, flow, _, slope = damper._system(lengths, branch)
        action = 0.02 * np.random.default_rng(seed).uniform(-1, 1, lengths.shape)
        v = env.core.simulation.rate * action / damper.time
        kick = -np.einsum("nij,nj->ni", jump, v)
        expected = np.einsum("nij,nj->ni", flow[:, :, modes.count :], kick)
        observation = env.step(action[0])[0]
        moved = lengths + v * damper.time
        observation = {key: value[None] for key, value in observation.items()}
        found, rate, _ = modes.read(env.core.schema.decode(observation), moved)
        speed = rate - np.einsum("nij,nj->ni", slope, v)
        size = np.abs(kick).max()
        np.testing.assert_allclose(speed / size, expected[:, modes.count :] / size, atol=0.05)
        size = np.abs(expected[:, : modes.count]).max()
        np.testing.assert_allclose(found / size, expected[:, : modes.count] / size, atol=0.05)


def test_zero_vibration_shaping_leaves_nothing_of_a_mode():
    """The shaped plan's residual at the modes where it ends, against that of the plan itself."""
    envs = gym.make_vec(FOUR_BAR, 8, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    core = envs.unwrapped.core
    observation, _ = envs.reset(seed=0)
    residual = {}
    for pace in ("full", "shaped"):
        controller = PlannedPath(core, planar_four_bar.ClosedFormIK, pace, damped=False)
        controller.begin_episodes(np.ones(8, bool), core.design)
        _, memory = controller.predict(observation)
        observed = core.schema.decode(observation)
        plan = np.concatenate([observed.inputs[:, None], memory.plan], axis=1)
        _, _, branch = controller.modes.read(observed, plan[:, -1])
        halves = controller.damper.half_periods(plan[:, -1], branch)
        kick = np.diff(np.diff(plan, axis=1), axis=1)
        wave = np.exp(1j * np.pi * np.arange(kick.shape[1]) / halves[:, :, None])
        residual[pace] = np.abs(np.einsum("nkt,nti->nki", wave, kick))
    assert residual["shaped"].max() < 0.1 * residual["full"].max()


def test_controllers_plan_anew_when_an_episode_begins():
    for env_id in (FOUR_BAR, PRISM):
        envs = gym.make_vec(env_id, 4, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
        core = envs.unwrapped.core
        for name in ("closed_form_damped", "pseudo_inverse"):
            controller = DYNAMIC[gym.spec(env_id).kwargs["arm"]][name](core)
            observation, _ = envs.reset(seed=0)
            controller.begin_episodes(np.ones(4, bool), envs.unwrapped.design)
            alone, _ = controller.predict(observation)
            first, _ = envs.reset(seed=100)
            _, memory = controller.predict(first)
            second, *_ = envs.step(0.1 * np.ones(envs.action_space.shape))
            _, memory = controller.predict(second, memory, np.zeros(4, bool))
            again, _ = controller.predict(observation, memory, np.array([True, False, True, False]))
            np.testing.assert_allclose(again[[0, 2]], alone[[0, 2]], atol=1e-9)
            assert (again[[1, 3]] != alone[[1, 3]]).any()


def test_quasi_static_twins():
    for env_id in (FOUR_BAR, PRISM):
        pair = pair_of(env_id)
        still = gym.make(pair[0], observe_velocities=True)
        moving = gym.make(pair[1])
        assert still.observation_space == moving.observation_space
        a, b = still.reset(seed=4)[0], moving.reset(seed=4)[0]
        for key, value in a.items():
            np.testing.assert_allclose(value, b[key], atol=1e-6)
    specs = [gym.spec(env_id).kwargs for env_id in tensegrity_envs.ENV_IDS]
    still = {kwargs["arm"] for kwargs in specs if kwargs.get("backend") != "mujoco"}
    assert set(DYNAMIC) & still <= set(BASELINES)
