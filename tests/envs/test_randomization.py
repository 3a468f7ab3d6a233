"""Randomization: recorded, reproducible, and with exactly the effect that it says."""

import gymnasium as gym
import numpy as np
import pytest

from tensegrity_envs.randomization import Randomization

REST = ("tensegrity/TwoXTensionReach-v0", "tensegrity/TwoXPayloadReach-v0", "tensegrity/DualTriangleLoadedReach-v0")
MOVING = ("tensegrity/TwoXTensionReachMuJoCo-v0", "tensegrity/DualTriangleLoadedReachMuJoCo-v0")
EVERYTHING = {"stiffness": (0.8, 1.2), "actuation_delay": (0, 3), "tip_noise": 0.001, "angle_noise": 0.01}


def make(env_id, **options):
    if "MuJoCo" in env_id:
        pytest.importorskip("mujoco")
    return gym.make(env_id, **options)


def make_vec(env_id, count, **options):
    if "MuJoCo" in env_id:
        pytest.importorskip("mujoco")
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)


def actions_of(env, steps, seed=0, scale=1.0):
    return scale * np.random.default_rng(seed).uniform(-1, 1, (steps, *env.action_space.shape))


def options_of(env_id):
    more = {"mass": (0.8, 1.2), "damping": (0.5, 2.0)} if env_id in MOVING else {}
    if env_id == "tensegrity/TwoXTensionReach-v0":
        more = {"mass": (0.8, 1.2)}
    return EVERYTHING | more


@pytest.mark.parametrize("env_id", REST + MOVING)
def test_single_and_vector_environments_draw_the_same_and_rewards_are_relabelled_right(env_id):
    randomization = options_of(env_id)
    envs, env = make_vec(env_id, 5, randomization=randomization), make(env_id, randomization=randomization)
    many, all_info = envs.reset(seed=10)
    one, info = env.reset(seed=13)
    for name in randomization:
        if "noise" not in name:
            low, high = randomization[name]
            drawn = all_info[f"random_{name}"]
            assert ((drawn >= low) & (drawn <= high)).all()
            assert len(np.unique(drawn)) > 1
            assert drawn[3] == info[f"random_{name}"]
    for action in actions_of(envs, 40, scale=0.3).astype(np.float32):
        many, rewards, terminated, _, all_info = envs.step(action)
        one, reward, ended, _, info = env.step(action[3])
        assert (rewards[3], terminated[3]) == (reward, ended)
        again = env.unwrapped.compute_reward(one["achieved_goal"], one["desired_goal"], info)
        assert again == pytest.approx(reward, abs=1e-9)
        if ended:
            break
        for key, value in one.items():
            np.testing.assert_array_equal(many[key][3], value)


@pytest.mark.parametrize("env_id", REST + MOVING)
def test_a_delay_shifts_the_actions_and_does_nothing_else(env_id):
    plain, late = make(env_id), make(env_id, randomization={"actuation_delay": (2, 2)})
    plain.reset(seed=4)
    late.reset(seed=4)
    actions = actions_of(plain, 30, scale=0.3)
    still = np.zeros_like(actions[:1])
    padded = np.concatenate([still, still, actions])  # what the delayed arm does
    for given, taken in zip(np.concatenate([actions, still, still]), padded):
        a, b = plain.step(taken), late.step(given)
        np.testing.assert_array_equal(a[0]["observation"], b[0]["observation"])
        assert a[1:4] == b[1:4]
        if a[2]:
            break


@pytest.mark.parametrize("env_id", REST[:1] + MOVING)
def test_noise_is_of_the_sensors_only_and_of_the_size_that_was_asked_for(env_id):
    plain, noisy = make_vec(env_id, 200), make_vec(env_id, 200, randomization={"tip_noise": 0.002})
    a, _ = plain.reset(seed=0)
    b, _ = noisy.reset(seed=0)
    errors = [b["achieved_goal"] - a["achieved_goal"]]
    for _ in range(20):
        still = np.zeros(plain.action_space.shape)
        a, reward, _, _, info = plain.step(still)
        b, same_reward, _, _, noisy_info = noisy.step(still)
        np.testing.assert_array_equal(info["configuration"], noisy_info["configuration"])
        np.testing.assert_array_equal(reward, same_reward)
        np.testing.assert_allclose(noisy_info["true_goal"], a["achieved_goal"], atol=1e-7)
        errors.append(b["achieved_goal"] - a["achieved_goal"])
    errors = np.array(errors)
    assert errors.std() == pytest.approx(0.002, rel=0.05)
    assert abs(errors.mean()) < 0.002 / 20
    steps = errors.reshape(21, -1)
    assert abs(np.corrcoef(steps[:-1].ravel(), steps[1:].ravel())[0, 1]) < 0.05


def test_standard_normal_numbers_depend_on_key_and_step_alone():
    keys, steps = np.arange(5000.0), np.full(5000, 7.0)
    z = Randomization.normals(keys, steps, 4)
    assert z.mean() == pytest.approx(0, abs=0.03)
    assert z.std() == pytest.approx(1, abs=0.03)
    np.testing.assert_array_equal(Randomization.normals(keys[9:10], steps[:1], 4)[:, 0], z[:, 9])


def test_a_payload_in_the_randomization_is_the_payload_range():
    a = make("tensegrity/TwoXTensionReach-v0", randomization={"payload": (0.0, 0.4)}, observe="tip_and_inputs")
    b = make("tensegrity/TwoXPayloadReach-v0")
    (first, info), (second, other) = a.reset(seed=8), b.reset(seed=8)
    np.testing.assert_array_equal(first["observation"], second["observation"])
    assert info["payload"] == other["payload"]
    with pytest.raises(ValueError, match="give one of them"):
        make("tensegrity/TwoXPayloadReach-v0", randomization={"payload": (0.0, 0.4)})


def test_stiffness_and_mass_act_on_the_mechanism():
    env = make("tensegrity/TwoXTensionReach-v0", randomization={"stiffness": (1.5, 1.5), "mass": (2.0, 2.0)})
    env.reset(seed=0)
    design, nominal = env.unwrapped.episode.design, env.unwrapped.design
    assert design.k1 == 1.5 * nominal.k1
    assert design.bar_density == 2 * nominal.bar_density


def test_a_randomized_simulation_is_that_of_an_arm_built_so():
    pytest.importorskip("mujoco")
    from dataclasses import replace

    from tensegrity_envs.mechanics import MURALIDHARAN2022

    env_id = "tensegrity/TwoXTensionReachMuJoCo-v0"
    fields = {"k1": 1.1 * MURALIDHARAN2022.k1, "k2": 1.1 * MURALIDHARAN2022.k2}
    design = replace(MURALIDHARAN2022, bar_density=1.2 * MURALIDHARAN2022.bar_density, **fields)
    factors = {"stiffness": (1.1, 1.1), "mass": (1.2, 1.2), "damping": (2.0, 2.0)}
    drawn = make(env_id, randomization=factors)
    built = make(env_id, design=design, dynamics={"joint_damping": 0.04})
    drawn.reset(seed=1)
    built.reset(seed=1)
    for action in actions_of(drawn, 30, scale=0.5):
        a, b = drawn.step(action), built.step(action)
        np.testing.assert_allclose(a[4]["configuration"], b[4]["configuration"], atol=1e-6)
        if a[2]:
            break


@pytest.mark.parametrize(
    ("randomization", "message"),
    [
        ({"stifness": (1, 2)}, "there is no 'stifness'"),
        ({"stiffness": (2, 1)}, "stiffness"),
        ({"stiffness": 3}, "low, high"),
        ({"actuation_delay": (0, 1.5)}, "whole numbers"),
        ({"tip_noise": -1}, "tip_noise"),
        ({"damping": (1, 2)}, "does not apply"),
    ],
)
def test_what_cannot_be_randomized_is_named(randomization, message):
    with pytest.raises(ValueError, match=message):
        make("tensegrity/DualTriangleReach-v0", randomization=randomization)
    with pytest.raises(TypeError, match="dict"):
        make("tensegrity/DualTriangleReach-v0", randomization="stiffness")
