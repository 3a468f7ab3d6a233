"""Input shaping and the regulator of the fast tasks."""

import gymnasium as gym
import numpy as np
import pytest
from scipy.linalg import expm

pytest.importorskip("mujoco")

from baseline_runs import columns_of
from tensegrity_agents.controllers.input_shaping import Vibration, shaped, vibration_of
from tensegrity_envs.simulation.mujoco.linearizing import linearize

IDS = ("tensegrity/TwoXFastReachMuJoCo-v0", "tensegrity/DualTriangleFastReachMuJoCo-v0")
STEP = 0.02  # [s]


def oscillator(frequency, damping):
    """Transition over a step of x'' + 2 z w x' + w^2 x = w^2 u."""
    w = 2 * np.pi * frequency
    return expm(STEP * np.array([[0.0, 1.0], [-(w**2), -2 * damping * w]]))


@pytest.mark.parametrize("shaper", ["ZV", "ZVD"])
def test_a_shaped_step_leaves_an_oscillator_at_rest(shaper):
    """A mode of 12.5 steps half period: simulated exactly, with inputs held over each step."""
    a = oscillator(2.0, 0.02)
    vibration = vibration_of(a[None], 2)
    np.testing.assert_allclose(vibration.half_period[0], [0.25 / STEP / np.sqrt(1 - 0.02**2), 0.0], rtol=1e-9)
    assert vibration.decay[0, 0] == pytest.approx(np.exp(-0.02 * np.pi / np.sqrt(1 - 0.02**2)))
    left = {}
    for name, plan in {
        "step": np.ones((1, 80, 1)),
        "shaped": shaped(np.zeros((1, 1)), np.ones((1, 80, 1)), vibration, shaper)[:, :80],
    }.items():
        x = np.zeros(2)
        for u in plan[0, :, 0]:
            rest = np.array([u, 0.0])
            x = rest + a @ (x - rest)
        left[name] = np.hypot(x[0] - 1.0, x[1] / (4 * np.pi))
    assert left["step"] > 0.5 and left["shaped"] < 0.02


def test_zvd_bears_a_wrong_frequency_better_than_zv():
    vibration = vibration_of(oscillator(2.0, 0.0)[None], 1)
    a, left = oscillator(2.2, 0.0), {}
    for shaper in ("ZV", "ZVD"):
        x = np.zeros(2)
        for u in shaped(np.zeros((1, 1)), np.ones((1, 80, 1)), vibration, shaper)[0, :, 0]:
            rest = np.array([u, 0.0])
            x = rest + a @ (x - rest)
        left[shaper] = np.hypot(x[0] - 1.0, x[1] / (4.4 * np.pi))
    assert left["ZVD"] < 0.4 * left["ZV"]


def test_a_mode_that_is_not_there_shapes_nothing():
    plan = np.random.default_rng(0).normal(size=(2, 10, 3))
    same = shaped(plan[:, 0], plan, Vibration(np.zeros((2, 2)), np.ones((2, 2))), more=5)
    np.testing.assert_allclose(same[:, :10], plan)
    np.testing.assert_allclose(same[:, 10:], np.repeat(plan[:, -1:], 5, axis=1))


@pytest.mark.parametrize("env_id", IDS)
def test_the_linear_motion_is_that_of_the_simulation(env_id):
    """Against differences of whole steps of the simulation, loops closed, without friction."""
    env = gym.make(env_id, dynamics={"joint_friction": 0.0})
    core = env.unwrapped.core
    model, rng = core.engine.model, np.random.default_rng(0)
    n, joints = model.linkage.size, model.joint_angles(np.arange(model.state_size, dtype=float)).size
    for seed in range(3):
        info = env.reset(seed=seed)[1]
        inputs = np.array(core.simulation.actuation(core.nominal, tuple(info[core.input_name])))
        low, high = model.input_bounds
        inputs = np.clip(inputs, low + 0.01 * (high - low), high - 0.01 * (high - low))  # off the bounds: smooth
        q = info["configuration"]
        motion = linearize(model, q, inputs)

        def stepped(q, velocity, command, reached):
            after = model.rollout(model.state(q, velocity, reached)[None], command).states[0]
            return np.concatenate([model.configuration(after), model.velocity(after), after[1 + 2 * joints :]])

        dq, dv = 1e-4 * rng.normal(size=(2, n))
        du = 1e-4 * (high - low) * rng.normal(size=len(inputs))
        ends = [stepped(q + s * dq, s * dv, inputs + s * du, inputs) for s in (1, -1)]
        found = (ends[0] - ends[1]) / 2
        expected = motion.a @ np.concatenate([dq, dv, 0 * inputs]) + motion.b @ du
        np.testing.assert_allclose(expected, found, atol=0.02 * np.abs(found).max())


@pytest.mark.parametrize("env_id", IDS)
def test_the_regulator_settles_sooner_than_the_ramp(env_id):
    settled = {}
    for name in ("closed_form_ramp", "lqr"):
        columns = columns_of(env_id, name)
        assert columns["success"].mean() >= 0.9
        settled[name] = np.median(columns["settling_time_s"])
    assert settled["lqr"] < 0.75 * settled["closed_form_ramp"]


def test_sizes_are_checked():
    model = gym.make("tensegrity/SpatialPrismTrackMuJoCo-v0").unwrapped.core.engine.model
    with pytest.raises(ValueError, match=r"configuration of shape \(7,\): must be \(6,\)"):
        linearize(model, np.zeros(7), np.zeros(3))
    with pytest.raises(ValueError, match=r"inputs of shape \(2,\): must be \(3,\)"):
        linearize(model, np.zeros(6), np.zeros(2))
