"""Targets and starts of one's own: what is feasible begins there, what is not is refused with the reason."""

import gymnasium as gym
import numpy as np
import pytest

import tensegrity_envs

# id, a feasible target, a feasible start, and what the message says of an infeasible target and start
CASES = {
    "TwoXReach": ((0.1, 0.45), (0.3, -0.2), ((0.9, 0.9), "no stable"), ((0.0, 2.9), "joint limits")),
    "TwoXTensionReach": ((0.1, 0.45), (0.3, -0.2), ((0.9, 0.9), "no stable"), ((2.5, 2.5), "not stable")),
    "TwoXPayloadReach": ((0.1, 0.45), (0.3, -0.2), ((0.9, 0.9), "no stable"), ((2.5, 2.5), "not stable")),
    "TwoXTensionReachMuJoCo": ((0.1, 0.45), (0.3, -0.2), ((0.9, 0.9), "no stable"), ((2.5, 2.5), "not stable")),
    "ThreeXReach": ((0.3, 0.7), (0.3, -0.2, 0.4), ((0.0, -0.9), "no stable"), ((0.0, 0.0, 2.9), "joint limits")),
    "ThreeXTensionReach": ((0.3, 0.7), (0.3, -0.2, 0.4), ((0, -0.9), "no stable"), ((2.5,) * 3, "not stable")),
    "DualTriangleReach": ((0.2, 0.1), (0.3, -0.2, 0.1), ((0.9, 0.0), "out of reach"), ((3.0, 0, 0), "joint limits")),
    "DualTriangleReachMuJoCo": ((0.2, 0.1), (0.3, 0, 0.1), ((0.9, 0.0), "out of reach"), ((3, 0, 0), "joint limits")),
    "DualTrianglePush": ((0.28, 0.0), None, ((0.2, 0.1), "must be"), ((0.5, 0.5, 0.5), r"must be \(x, 0\)")),
    "TwoXPostureChange": (None, (-0.85, -0.9), ((0.0, 0.0), "singular"), ((0.0, 0.0), "singular")),
    "PlanarFourBarReach": ((9.0, 16.0), None, ((90.0, 0.0), "no stable state"), ((0.3, 0.2), "cannot be chosen")),
    "SpatialPrismTrack": (None, None, ((0.0, 0.0, 0.5), "curve"), ((0.0, 0, 0.5, 0, 0, 0), "curve")),
}


def make(name):
    if "MuJoCo" in name:
        pytest.importorskip("mujoco")
    return gym.make(name if "/" in name else f"tensegrity/{name}-v0").unwrapped


@pytest.mark.parametrize("name", CASES)
def test_chosen_episodes(name):
    env = make(name)
    target, start, *_ = CASES[name]
    drawn, _ = env.reset(seed=1)
    if target is not None:
        observation, info = env.reset(seed=1, options={"target": target})
        np.testing.assert_allclose(observation["desired_goal"], target, atol=1e-7)
        reward = env.compute_reward(observation["achieved_goal"], observation["desired_goal"], info)
        assert np.isfinite(reward)
        assert env.observation_space.contains(observation)
        *_, info = env.step(np.zeros(env.action_space.shape))
        assert np.isfinite(info[env.core.error_name])
    if start is not None:
        observation, info = env.reset(seed=1, options={"configuration": start})
        np.testing.assert_array_equal(observation["desired_goal"], drawn["desired_goal"])
        if "Payload" not in name:  # whose arm sags
            np.testing.assert_allclose(info["configuration"], start, atol=1e-6)
    if target is not None and start is not None:
        observation, info = env.reset(options={"target": target, "configuration": start})
        np.testing.assert_allclose(observation["desired_goal"], target, atol=1e-7)


@pytest.mark.parametrize("name", CASES)
def test_infeasible_episodes_are_refused_and_change_nothing(name):
    env, twin = make(name), make(name)
    for environment in (env, twin):
        environment.reset(seed=1)
    for option, (value, message) in zip(("target", "configuration"), CASES[name][2:], strict=True):
        with pytest.raises(ValueError, match=message):
            env.reset(options={option: value})
        for bad in (value[:-1], (*value[:-1], np.nan), "far", [None] * len(value)):
            with pytest.raises(ValueError, match=f"'{option}'"):
                env.reset(options={option: bad})
    action = np.full(env.action_space.shape, 0.1)
    for mine, other in zip(env.step(action)[0].values(), twin.step(action)[0].values(), strict=True):
        np.testing.assert_array_equal(mine, other)
    for mine, other in zip(env.reset()[0].values(), twin.reset()[0].values(), strict=True):
        np.testing.assert_array_equal(mine, other)


@pytest.mark.parametrize("env_id", tensegrity_envs.ENV_IDS)
def test_episodes_of_other_seeds_are_taken_or_refused_and_what_is_no_number_is_refused(env_id):
    """For every id: what cannot be chosen is refused with a reason, and what is refused changes nothing."""
    env, twin = make(env_id), make(env_id)
    observation, info = env.reset(seed=2)
    given = {"target": observation["desired_goal"], "configuration": info["configuration"]}
    for environment in (env, twin):
        environment.reset(seed=1)
    drawn = twin.reset()[0]
    for option, value in given.items():
        try:
            observation, info = env.reset(seed=1, options={option: value})
        except ValueError as error:
            assert len(str(error)) > 20
        else:
            if option == "target":
                np.testing.assert_allclose(observation["desired_goal"], value, atol=1e-6)
        env.reset(seed=1)
        with pytest.raises(ValueError, match=option):
            env.reset(seed=5, options={option: np.nan * value})
    for mine, other in zip(env.reset()[0].values(), drawn.values(), strict=True):
        np.testing.assert_array_equal(mine, other)


def test_a_target_in_another_piece_of_the_feasible_set_is_refused():
    """With half a kilogram the set falls apart: some targets cannot be reached from some starts."""
    env = gym.make("tensegrity/TwoXTensionReach-v0", design={"payload": 0.5}).unwrapped
    other = gym.make("tensegrity/TwoXTensionReach-v0", design={"payload": 0.5}).unwrapped
    refused = 0
    for seed in range(40):
        goal = other.reset(seed=seed)[0]["desired_goal"]
        env.reset(seed=0)
        try:
            env.reset(seed=0, options={"target": goal})
        except ValueError as error:
            assert "another connected component" in str(error)
            refused += 1
    assert 0 < refused < 40


def test_a_chosen_episode_takes_the_place_of_a_drawn_one():
    env, twin = make("TwoXReach"), make("TwoXReach")
    env.reset(seed=3, options={"target": (0.1, 0.45)})
    twin.reset(seed=3)
    np.testing.assert_array_equal(env.reset()[0]["desired_goal"], twin.reset()[0]["desired_goal"])


@pytest.mark.parametrize("given", [[0], "ab", [1, 0], [-1, 1], [0, float("inf")], 3, [None, 1]])
@pytest.mark.parametrize(
    ("env_id", "name"),
    [
        ("TwoXPayloadReach", "payload_range"),
        ("DualTriangleLoadedReach", "load_range"),
        ("PlanarFourBarLoadedReach", "load_range"),
        ("SpatialPrismPayloadTrack", "payload_range"),
    ],
)
def test_ranges_that_are_none_are_refused(env_id, name, given):
    with pytest.raises(ValueError, match=f"{name} = .*must be"):
        gym.make(f"tensegrity/{env_id}-v0", **{name: given})


@pytest.mark.parametrize("options", [{"target": (50.0, 50.0)}, {"target": (50.0, 50.0), "episode": 7}])
def test_a_refused_reset_changes_nothing_whatever_seed_comes_with_it(options):
    env, twin = make("TwoXReach"), make("TwoXReach")
    for environment in (env, twin):
        environment.reset(seed=0)
    with pytest.raises(ValueError, match="target"):
        env.reset(seed=5, options=options)
    np.testing.assert_array_equal(env.reset()[0]["desired_goal"], twin.reset()[0]["desired_goal"])


def test_a_chosen_episode_keeps_what_its_seed_and_number_have_drawn():
    env, twin = make("TwoXReach"), make("TwoXReach")
    chosen, _ = env.reset(seed=5, options={"episode": 3, "target": (0.1, 0.45)})
    twin.reset(seed=5)
    drawn, _ = twin.reset(options={"episode": 3})
    np.testing.assert_array_equal(chosen["achieved_goal"], drawn["achieved_goal"])
    np.testing.assert_array_equal(env.reset()[0]["desired_goal"], twin.reset()[0]["desired_goal"])
