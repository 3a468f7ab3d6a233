"""What is particular to reaching with a commanded stiffness."""

import math

import gymnasium as gym
import numpy as np
import pytest

import tensegrity_envs  # noqa: F401
from tensegrity_agents.controllers import make_controller
from tensegrity_envs.mechanics.n_x.postures import postures_at

TWO, THREE = (f"tensegrity/{arm}StiffnessReach-v0" for arm in ("TwoX", "ThreeX"))
BOTH = pytest.mark.parametrize("env_id", [TWO, THREE])


def make_vec(env_id, count, **options):
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)


def compliance_by_differences(arm, q, tensions):
    """C, from where the arm comes to rest under small forces at constant tensions."""
    columns = []
    force = 1e-5 * arm.reach * float(arm.stiffness(q, tensions))
    for fx, fy in ((force, 0.0), (0.0, force)):
        ends = [arm.equilibrium(tensions, q, (sign * fx, sign * fy)) for sign in (1, -1)]
        assert all(end.is_stable for end in ends)
        plus, minus = (np.array(arm.tip(end.configuration)) for end in ends)
        columns.append((plus - minus) / (2 * force))
    return np.stack(columns, axis=1)


@BOTH
def test_the_achieved_stiffness_is_that_of_loaded_equilibria(env_id):
    envs = make_vec(env_id, 24)
    observation, info = envs.reset(seed=0)
    core, rng = envs.unwrapped.core, np.random.default_rng(0)
    for _ in range(12):
        observation, _, _, _, info = envs.step(rng.uniform(-1, 1, envs.action_space.shape))
    looked = 0
    for i in np.flatnonzero(info["stability_margin"] > 0.02):
        q, tensions = tuple(info["configuration"][i].tolist()), tuple(info["tensions"][i].tolist())
        compliance = compliance_by_differences(core.nominal, q, tensions)
        stiffness = 1 / np.linalg.eigvalsh((compliance + compliance.T) / 2)[-1]
        assert info["stiffness"][i] == pytest.approx(stiffness, rel=1e-4)
        assert observation["achieved_goal"][i, 2] == pytest.approx(math.log(stiffness / core.reference), abs=2e-4)
        looked += 1
    assert looked > 12


@BOTH
def test_every_episode_can_be_solved_by_tensions_that_hold_a_posture_of_the_target(env_id):
    core = gym.make(env_id).unwrapped.core
    n = 60
    seed, episode = np.zeros(n, int), np.arange(n)
    goal = np.stack(core.sample(seed, episode).episode.goal)
    wanted = core.reference * np.exp(goal[2])
    drawn = core.sampler.sample(seed, episode, core.design)
    q = drawn.target_configuration
    np.testing.assert_allclose(np.stack(core.nominal.tip(q)), goal[:2], atol=1e-7)
    least, greatest = core.nominal.stiffness_range(q)
    assert (wanted > least).all()
    assert (wanted < greatest).all()
    tensions = core.nominal.tensions_for(q, wanted)
    np.testing.assert_allclose(core.nominal.stiffness(q, tensions), wanted, rtol=1e-6)
    assert np.abs(np.stack(core.nominal.energy_gradient(q, tensions))).max() < 1e-9 * core.design.max_tension
    assert np.min(tensions) >= core.design.min_tension - 1e-9
    assert np.max(tensions) <= core.design.max_tension + 1e-9
    assert (core.nominal.stability_margin(q, tensions) > 0).all()


@BOTH
def test_the_oracle_brings_the_tip_to_the_target_as_stiff_as_asked(env_id):
    count = 24
    envs = make_vec(env_id, count)
    controller = make_controller("oracle", env_id)
    observation, info = envs.reset(seed=3)
    controller.begin_episodes(np.ones(count, bool), envs.unwrapped.design, envs.unwrapped.episode)
    state, core = None, envs.unwrapped.core
    goal = observation["desired_goal"].copy()
    for step in range(99):
        action, state = controller.predict(observation, state, np.full(count, step == 0))
        observation, _, terminated, _, info = envs.step(action)
        assert not terminated.any()
    tip = np.stack(core.nominal.tip(tuple(info["configuration"].T)), axis=1)
    stiffness = core.nominal.stiffness(tuple(info["configuration"].T), tuple(info["tensions"].T))
    np.testing.assert_allclose(np.hypot(*(tip - goal[:, :2]).T), info["tip_error"], atol=1e-9)
    off = np.abs(np.log(stiffness / core.reference) - goal[:, 2])
    both = (info["tip_error"] <= core.task.tolerance) & (off <= math.log(1.05))
    np.testing.assert_array_equal(info["is_success"], both)
    assert both.mean() >= 0.95
    # exact where it arrives: the goal is a float32 number
    assert np.median(info["goal_error"]) < 1e-6


@BOTH
def test_neither_tip_nor_stiffness_alone_is_success(env_id):
    env = gym.make(env_id).unwrapped
    observation, _ = env.reset(seed=1)
    here = observation["achieved_goal"].astype(float)
    tolerance, core = env.core.task.tolerance, env.core
    for off, fits in (
        ((0, 0, 0), True),
        ((0.9 * tolerance, 0, math.log(1.04)), True),
        ((1.1 * tolerance, 0, 0), False),
        ((0, 0, math.log(1.06)), False),
        ((0, 0, -math.log(1.06)), False),
    ):
        error = float(core.error(np, tuple(here), tuple(here + np.array(off))))
        assert (error <= tolerance) == fits
    sparse = gym.make(env_id, reward_type="sparse").unwrapped
    goals = np.array([here, here + np.array([0, 0, 0.2])])
    np.testing.assert_array_equal(sparse.compute_reward(np.array([here, here]), goals, None), [1.0, 0.0])


def test_a_target_of_ones_own_must_be_as_stiff_as_it_can_be():
    env = gym.make(TWO)
    core = env.unwrapped.core
    observation, _ = env.reset(seed=0)
    x, y, _ = observation["desired_goal"].astype(float)
    q = np.stack(core.nominal.inverse_kinematics_batch(np.array([x]), np.array([y])))[:, 0]
    q = q[:, np.isfinite(q[0])]
    greatest = np.max(core.nominal.stiffness_range(tuple(q))[1])
    with pytest.raises(ValueError, match=r"N/m; the postures with the tip there have .* to .* N/m"):
        env.reset(seed=0, options={"target": (x, y, math.log(1.01 * greatest / core.reference))})
    wanted = math.log(0.97 * greatest / core.reference)
    observation, _ = env.reset(seed=0, options={"target": (x, y, wanted)})
    np.testing.assert_allclose(observation["desired_goal"], (x, y, wanted), atol=1e-6)


@BOTH
def test_stiffness_along_a_direction(env_id):
    envs = make_vec(env_id, 16, direction=(1.0, 2.0))
    _, info = envs.reset(seed=0)
    core = envs.unwrapped.core
    for i in range(16):
        q, tensions = tuple(info["configuration"][i].tolist()), tuple(info["tensions"][i].tolist())
        (xx, xy), (_, yy) = core.nominal.tip_compliance(q, tensions)
        assert info["stiffness"][i] == pytest.approx(5 / (xx + 4 * xy + 4 * yy), rel=1e-9)
    with pytest.raises(ValueError, match="direction"):
        gym.make(env_id, direction=(0.0, 0.0))


@pytest.mark.parametrize("scale", [1e-300, 1e-170, 1e170, 1e300, 3.0])
def test_a_direction_counts_by_its_angle_alone(scale):
    usual, scaled = (gym.make(TWO, direction=(size, size)).reset(seed=0) for size in (1.0, scale))
    assert np.isfinite(usual[1]["stiffness"])
    assert scaled[1]["stiffness"] == pytest.approx(usual[1]["stiffness"], rel=1e-12)
    for name, values in usual[0].items():
        np.testing.assert_allclose(scaled[0][name], values, rtol=1e-6)


def test_the_caption_tells_the_stiffness_and_the_commanded_one():
    env = gym.make(TWO).unwrapped
    observation, info = env.reset(seed=0)
    wanted = env.core.reference * math.exp(float(observation["desired_goal"][2]))
    assert env.scene().caption.endswith(f"stiffness {info['stiffness']:.3g} N/m, commanded {wanted:.3g}")


def test_what_makes_no_sense_is_refused():
    for options, message in (
        ({"control": "joint"}, "control = 'joint'"),
        ({"payload_range": (0.0, 0.3)}, "payload_range"),
        *(
            ({"stiffness_tolerance": given}, f"stiffness_tolerance = {given!r}: must be a positive number.*0.05")
            for given in (0.0, "a", None, True, math.nan, math.inf)
        ),
        *(
            ({"direction": given}, r"direction = .*: must be two finite numbers \(x, y\).*\(0.0, 1.0\)")
            for given in ("y", "xy", "12", 0.7, (1.0,), (1, 2, 3), (0.0, 0.0), (math.nan, 1.0), (math.inf, 0.0))
        ),
        ({"randomization": {"stiffness": (0.9, 1.1)}}, "stiffness"),
    ):
        with pytest.raises(ValueError, match=message):
            gym.make(TWO, **options)


def test_solutions_of_the_dense_reward_are_those_that_can_be_as_stiff_as_asked():
    core = gym.make(TWO).unwrapped.core
    sampled = core.sample(np.zeros(40, int), np.arange(40))
    goal = np.stack(sampled.episode.goal)
    finite = 0
    for q in sampled.episode.solutions:
        known = np.isfinite(q[0])
        finite += known.sum()
        least, greatest = core.nominal.stiffness_range(tuple(np.where(known, a, 0.0) for a in q))
        wanted = core.reference * np.exp(goal[2])
        assert ((wanted >= least * (1 - 1e-5)) & (wanted <= greatest * (1 + 1e-5)))[known].all()
    assert finite >= 40


def test_targets_of_three_joints_have_postures_as_stiff_as_asked():
    core = gym.make(THREE).unwrapped.core
    goal = np.stack(core.sample(np.zeros(60, int), np.arange(60)).episode.goal)
    owner, q = postures_at(core.nominal, *goal[:2])
    fits = core.is_range_of(core.nominal, tuple(q), goal[2][owner])
    assert len(np.unique(owner[fits])) >= 57
