"""Levels of uncertainty: what they draw, what they leave as it is, and that success is that of the true tip."""

import gymnasium as gym
import numpy as np
import pytest

import tensegrity_envs
from tensegrity_envs.uncertainty import LEVELS, checked_levels

UNCERTAIN = [env_id for env_id in tensegrity_envs.ENV_IDS if "Uncertain" in env_id]
every_id = pytest.mark.parametrize("env_id", UNCERTAIN)


def make_vec(env_id, count, **options):
    if "MuJoCo" in env_id:
        pytest.importorskip("mujoco")
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)


def played(envs, steps=5):
    observation, info = envs.reset(seed=3)
    rng, told = np.random.default_rng(0), [observation]
    for _ in range(steps):
        observation, *rest, info = envs.step(0.3 * rng.uniform(-1, 1, envs.action_space.shape))
        told += [observation, *rest]
    return told, info


@every_id
def test_level_0_is_the_environment_without_uncertainty(env_id):
    own = {"dynamics": dict(gym.spec(env_id).kwargs["dynamics"])} if "TwoXTensionReachUncertainMuJoCo" in env_id else {}
    base = make_vec(env_id.replace("Uncertain", ""), 4, **own)  # which has hinges and cables of its own
    for told, expected in zip(played(make_vec(env_id, 4, level=0))[0], played(base)[0], strict=True):
        np.testing.assert_equal(told, expected)


@every_id
@pytest.mark.parametrize("level", [1, 2, 3])
def test_what_is_drawn_fills_the_ranges_of_the_level(env_id, level):
    envs = make_vec(env_id, 400, level=level)
    info = envs.reset(seed=1)[1]
    for name, value in LEVELS[level].items():
        if f"random_{name}" not in info:
            assert name in {"mass", "damping", "friction", "bandwidth", "tip_noise", "angle_noise"}
            continue
        low, high = value
        drawn = info[f"random_{name}"]
        assert low <= drawn.min() <= low + 0.05 * (high - low)
        assert high >= drawn.max() >= high - 0.05 * (high - low)
    seen = envs.unwrapped.core.randomization
    assert seen.tip_noise == envs.unwrapped.core.noise_scale * LEVELS[level]["tip_noise"]
    shows_angles = "TwoXTension" in env_id or "FourBarReach" in env_id
    assert (seen.angle_noise > 0) == shows_angles  # only where angles are observed
    ids = make_vec(env_id, 4)
    assert ids.unwrapped.core.randomization == make_vec(env_id, 4, level=2).unwrapped.core.randomization


@every_id
def test_success_is_that_of_the_true_tip(env_id):
    envs = make_vec(env_id, 50)
    told, info = played(envs)
    observation, _, terminated, truncated = told[-4:]
    runs = ~(terminated | truncated)
    assert runs.sum() > 20
    off = np.linalg.norm(info["true_goal"] - observation["desired_goal"], axis=1)
    np.testing.assert_allclose(info["tip_error"][runs], off[runs], atol=1e-5)
    seen = np.linalg.norm(info["true_goal"] - observation["achieved_goal"], axis=1)
    assert 0.3e-3 < np.median(seen) / envs.unwrapped.core.noise_scale < 3e-3  # the noise of the sensor


def test_what_randomization_names_goes_before_the_level():
    core = gym.make(UNCERTAIN[0], randomization={"stiffness": (1.0, 1.5)}).unwrapped.core
    assert core.randomization.stiffness == (1.0, 1.5)
    assert core.randomization.actuation_delay == LEVELS[2]["actuation_delay"]


@pytest.mark.parametrize("level", [-1, 4, True, 1.0, "two"])
def test_levels_that_do_not_exist_are_refused(level):
    with pytest.raises(ValueError, match=r"level = .*: must be a whole number from 0"):
        gym.make("tensegrity/TwoXReach-v0", level=level)
    with pytest.raises(ValueError, match="nothing is uncertain in a push"):
        gym.make("tensegrity/DualTrianglePush-v0", level=1)


@pytest.mark.parametrize("env_id", ["tensegrity/TwoXTensionReachUncertain-v0", UNCERTAIN[-1]])
def test_an_episode_of_several_levels_is_that_of_the_one_it_draws(env_id):
    """To the bit, noise included; single and vector alike; the level is told by info alone."""
    levels = [3, 0, 2]
    mixed, single = make_vec(env_id, 24, level=levels), gym.make(env_id, level=levels)
    drawn = mixed.reset(seed=3)[1]["random_level"]
    assert set(drawn) == set(levels)
    told, info = played(mixed)
    goes_on = ~np.any([told[k + 2] | told[k + 3] for k in range(1, len(told), 4)], axis=0)
    for level in levels:
        envs = make_vec(env_id, 24, level=level)
        assert envs.observation_space == mixed.observation_space
        expected, other = played(envs)
        mine = goes_on & (drawn == level)
        assert mine.sum() > 2
        for a, b in zip(told, expected, strict=True):
            pairs = [(a[key], b[key]) for key in a] if isinstance(a, dict) else [(a, b)]
            for ours, theirs in pairs:
                np.testing.assert_array_equal(ours[mine], theirs[mine])
        if level:
            np.testing.assert_array_equal(info["random_stiffness"][mine], other["random_stiffness"][mine])
        else:
            assert (info["random_stiffness"][mine] == 1.0).all()
    chosen = int(np.flatnonzero(goes_on)[-1])
    observation, one = single.reset(seed=3 + chosen)
    rng = np.random.default_rng(0)
    for k in range(1, len(told), 4):
        action = (0.3 * rng.uniform(-1, 1, mixed.action_space.shape))[chosen]
        observation, reward, *_, one = single.step(action)
        assert reward == told[k + 1][chosen]
        assert one["random_level"] == drawn[chosen]
        for key, value in observation.items():
            np.testing.assert_array_equal(told[k][key][chosen], value)
        again = single.unwrapped.compute_reward(observation["achieved_goal"], observation["desired_goal"], one)
        assert again == pytest.approx(reward, abs=1e-9)


def test_all_levels_are_drawn_alike_and_anew_in_every_episode():
    core = gym.make(UNCERTAIN[0], level="drawn").unwrapped.core
    number = np.arange(4000)
    drawn = core.randomization.sample(0 * number, number)["level"]
    assert np.bincount(drawn.astype(int), minlength=4) / 4000 == pytest.approx(0.25, abs=0.03)
    assert core.randomization.longest_delay == LEVELS[3]["actuation_delay"][1]
    assert core.randomization.stiffness == LEVELS[3]["stiffness"]


@pytest.mark.parametrize("level", [[], [0, 0], [0, 4], [True], "some", [None, 1]])
def test_lists_of_levels_that_make_no_sense_are_refused(level):
    with pytest.raises(ValueError, match="level = "):
        checked_levels(level)
