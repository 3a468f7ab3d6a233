"""The analytic controllers of the planar 4-bar mechanism: what they identify, plan and reach."""

import gymnasium as gym
import numpy as np
import pytest

from baseline_runs import success_of
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.controllers.planar_four_bar.measurements import configuration, force_across
from tensegrity_agents.controllers.planar_four_bar.planning import ends, trips, waypoints
from tensegrity_envs.mechanics import PlanarFourBar
from tensegrity_envs.seeding import VALIDATION_SEED

REACH, LOADED = "tensegrity/PlanarFourBarReach-v0", "tensegrity/PlanarFourBarLoadedReach-v0"
UNCERTAIN = "tensegrity/PlanarFourBarLoadedReachUncertain-v0"
ARM = PlanarFourBar()


def make_vec(env_id, count, **options):
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)


@pytest.mark.parametrize(
    ("env_id", "name", "least", "most"),
    [
        (REACH, "closed_form_ik", 0.98, 1.0),
        (REACH, "pseudo_inverse", 0.97, 1.0),
        (REACH, "observer", 0.98, 1.0),
        (REACH, "oracle", 0.98, 1.0),
        (REACH, "random", 0.0, 0.05),
        (LOADED, "closed_form_ik", 0.0, 0.3),
        (LOADED, "pseudo_inverse", 0.5, 0.9),
        (LOADED, "observer", 0.95, 1.0),
        (LOADED, "oracle", 0.97, 1.0),
    ],
)
def test_success(env_id, name, least, most):
    assert least <= success_of(env_id, name) <= most


def test_readings_undo_the_observation():
    for env_id in (REACH, LOADED):
        envs = make_vec(env_id, 50)
        observation, info = envs.reset(seed=0)
        reading = envs.unwrapped.core.schema.decode(observation)
        np.testing.assert_allclose(reading.actuator_lengths, info["actuator_lengths"], atol=5e-6)
        gap = configuration(ARM, reading) - info["configuration"]
        assert np.abs(np.arctan2(np.sin(gap), np.cos(gap))).max() < 1e-5
        across, pull = force_across(ARM, reading)
        np.testing.assert_allclose(pull, (across * info["load"]).sum(axis=1), atol=0.02)


def test_the_observer_knows_the_force_after_two_steps():
    envs = make_vec(LOADED, 100)
    observation, info = envs.reset(seed=VALIDATION_SEED)
    observer = make_controller("observer", LOADED)
    observer.begin_episodes(np.ones(100, bool), envs.unwrapped.design, None)
    state, start, load = None, np.ones(100, bool), info["load"].copy()
    for _ in range(4):
        action, state = observer.predict(observation, state, start)
        observation, _, terminated, truncated, _ = envs.step(action)
        start = terminated | truncated
    error = np.hypot(*(observer.load(envs.unwrapped.core.schema.decode(observation), state) - load).T)
    assert np.median(error) < 0.02
    assert error[~start].max() < 5.0


def test_trips_are_what_the_environment_does():
    """A planned leg, followed in the environment step by step, ends where the plan says, or snaps."""
    envs = make_vec(LOADED, 60)
    observation, info = envs.reset(seed=7)
    core = envs.unwrapped.core
    load, start = info["load"].copy(), info["actuator_lengths"].copy()
    goal = waypoints(ARM, 60, seed=3)
    points = np.stack([start, goal, goal, goal], axis=1)
    tips, margin = trips(ARM, info["configuration"].copy(), points, load)
    end, failed, active = np.full((60, 2), np.nan), np.zeros(60, bool), np.ones(60, bool)
    for _ in range(99):
        gap = goal - info["actuator_lengths"]
        step = gap / np.maximum(np.abs(gap).max(axis=1, keepdims=True), core.simulation.rate)
        observation, _, terminated, _, info = envs.step(step)
        failed |= terminated & active
        active &= ~terminated
        end[active] = observation["achieved_goal"][active]
    stable = margin > 0.01
    assert stable.sum() > 20
    assert not failed[stable].any()
    np.testing.assert_allclose(end[stable], tips[stable], atol=1e-4)
    assert failed[margin < -0.5].mean() > 0.5


def test_ends_are_the_inverse_solutions():
    target, load = np.array([[2.0, 15.0], [0.0, 14.0], [100.0, 0.0]]), np.array([[0.0, 0.0], [20.0, 20.0], [0.0, 0.0]])
    index, lengths = ends(ARM, target, load, (0.2, 19.8))
    for k in range(3):
        expected = [s.lengths for s in ARM.inverse_kinematics(*target[k], load[k]) if s.is_stable]
        found = sorted(map(tuple, lengths[index == k].tolist()))
        assert len(found) >= len(expected)
        for solution in expected:
            assert min((np.abs(np.subtract(solution, f)).max() for f in found), default=1.0) < 1e-9


def test_an_oracle_without_the_truth_says_so():
    with pytest.raises(ValueError, match="privileged"):
        make_controller("oracle", LOADED).begin_episodes(np.ones(1, bool), ARM.design, None)


@pytest.mark.parametrize(("level", "least"), [(0, 0.98), (2, 0.95), (3, 0.95)])
def test_uncertain_mechanisms_reach(level, least):
    assert success_of(UNCERTAIN, "identifying_observer", level=level) >= least
    assert 0.6 <= success_of(UNCERTAIN, "servo", level=level) < 0.9  # it snaps, or comes to a fold, without the force
    if level:
        assert success_of(UNCERTAIN, "observer", level=level) < 0.6


def run_for(name, steps, count=200):
    """The environments after so many steps of a controller, which of them are still in their first episode, its memory
    and the info of the last step.
    """
    envs, controller = make_vec(UNCERTAIN, count), make_controller(name, UNCERTAIN)
    observation, info = envs.reset(seed=VALIDATION_SEED)
    privileged = envs.unwrapped.episode if controller.wants_privileged else None
    controller.begin_episodes(np.ones(count, bool), envs.unwrapped.design, privileged)
    memory, runs = None, np.ones(count, bool)
    for step in range(steps):
        action, memory = controller.predict(observation, memory, np.full(count, step == 0))
        observation, _, terminated, _, info = envs.step(action)
        runs &= ~terminated
    return envs, controller, observation, memory, runs, info


def test_the_force_is_identified_as_well_as_the_filter_says():
    """Of force and stiffness the ratio; the squared error in standard deviations has the mean 2 in two axes."""
    _, controller, observation, memory, runs, info = run_for("identifying_observer", 40)
    true = info["load"] / info["random_stiffness"][:, None]
    error = (controller.planner.load(controller.decode(observation), memory.plan) - true)[runs]
    squared = np.einsum("ni,nij,nj->n", error, memory.plan.information[runs], error)
    assert 0.5 < np.median(squared) < 2.5  # of a chi-squared number with two degrees of freedom: 1.39
    assert np.median(np.hypot(*error.T)) < 0.01 * 0.2 * ARM.largest_force


def test_where_the_command_leads_is_where_the_mechanism_comes_to_rest():
    """Behind whatever delay, and not only at the end: the command is held after 6 steps."""
    envs, controller, observation, memory, runs, info = run_for("informed", 6)
    observed = controller.decode(observation)
    load = controller.planner.load(observed, memory.plan)
    told = controller._under_command(observed, memory.inputs, load).tip
    for _ in range(4):
        _, _, terminated, _, info = envs.step(np.zeros((200, 2)))
        runs &= ~terminated
    moving = np.abs(observed.actuator_lengths - memory.inputs).max(axis=1) > 0.1
    assert (runs & moving).sum() > 50
    np.testing.assert_allclose(info["true_goal"][runs], told[runs], atol=1e-4)


@pytest.mark.parametrize(("level", "least"), [(0, 0.98), (2, 0.9)])
def test_in_dynamics_it_comes_to_rest_on_target_by_its_own_command(level, least):
    pytest.importorskip("mujoco")
    moving = "tensegrity/PlanarFourBarReachUncertainMuJoCo-v0"
    assert success_of(moving, "servo", level=level) >= least
    if level:
        assert success_of(moving, "closed_form_ramp", level=level) < 0.7  # its damping comes too late
