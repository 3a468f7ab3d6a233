"""The policies that come with the package: what was recorded of them, and how they are called."""

import warnings
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

import tensegrity_envs
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.rollout import ControllerError, evaluate
from tensegrity_agents.pretrained import FOLDER, load_pretrained, pretrained_ids
from tensegrity_envs.seeding import TEST_SEED

FAST, PAYLOAD = "tensegrity/DualTriangleFastReachMuJoCo-v0", "tensegrity/TwoXPayloadReachUncertain-v0"


@pytest.mark.parametrize("env_id", pretrained_ids())
def test_a_shipped_policy_does_what_was_recorded(env_id):
    recorded = (FOLDER / env_id.rpartition("/")[2] / "test_successes.txt").read_text().strip()
    found = evaluate(load_pretrained(env_id), env_id, 200, TEST_SEED, "policy").columns["success"]
    differ = sum(bool(now) != (then == "1") for now, then in zip(found, recorded[:200], strict=True))
    assert differ <= 2


def test_every_environment_has_a_policy_and_all_are_small():
    assert set(pretrained_ids()) == set(tensegrity_envs.ENV_IDS)
    assert sum(path.stat().st_size for path in FOLDER.rglob("*")) < 10e6


@pytest.mark.usefixtures("only_one_policy")
def test_a_policy_that_is_missing_is_named():
    with pytest.raises(ValueError, match=r"no policy is shipped for TwoXTensionReach-v0; there are policies for TwoXR"):
        load_pretrained("TwoXTensionReach-v0")


@pytest.mark.parametrize("env_id", pretrained_ids())
def test_within_an_episode_a_policy_needs_its_state_alone(env_id):
    """As recurrent policies of Stable-Baselines3 do: without `episode_start` none begins where there is a state."""
    (policy, other), states, begins = (load_pretrained(env_id) for _ in range(2)), [None, None], np.ones(3, bool)
    envs = gym.make_vec(env_id, 3, vectorization_mode="vector_entry_point")
    seen, _ = envs.reset(seed=TEST_SEED)
    for _ in range(4):
        told, states[0] = policy.predict(seen, states[0], begins)
        short, states[1] = other.predict(seen, states[1])
        np.testing.assert_array_equal(short, told)
        seen, _, terminated, truncated, _ = envs.step(told)
        begins = terminated | truncated
        assert not begins.any()
    envs.close()


@pytest.mark.parametrize(("env_id", "made"), [(FAST, load_pretrained), (PAYLOAD, partial(make_controller, "servo"))])
def test_who_is_never_handed_its_state_back_says_so_once(env_id, made):
    asked, envs = made(env_id), gym.make_vec(env_id, 2, vectorization_mode="vector_entry_point")
    seen, _ = envs.reset(seed=0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(7):  # as many episodes begin
            _, state = asked.predict(seen)
        asked.predict(seen, state)
        for _ in range(7):
            asked.predict(seen)
    with pytest.warns(UserWarning, match="called 8 times in a row without a state.*hand back the state"):
        asked.predict(seen)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(10):
            asked.predict(seen)
    envs.close()


def test_short_ids_and_what_is_no_number_of_episodes():
    planner = make_controller("closed_form_ik", "TwoXReach-v0")
    assert evaluate(planner, "TwoXReach-v0", 3, TEST_SEED, "planner").columns["success"].all()
    for wrong in (0, 2.5, True):
        with pytest.raises(ValueError, match=f"episodes = {wrong}: must be a whole number, 1 or more"):
            evaluate(planner, "TwoXReach-v0", wrong, TEST_SEED, "planner")
        with pytest.raises(ValueError, match=f"batch = {wrong}: must be a whole number, 1 or more"):
            evaluate(planner, "TwoXReach-v0", 3, TEST_SEED, "planner", batch=wrong)


def test_a_policy_of_another_environment_and_another_observation_are_refused():
    policy = load_pretrained("TwoXReach-v0")
    with pytest.raises(ControllerError, match=r"made for another environment: .*; here: DualTriangle"):
        evaluate(policy, "DualTriangleReach-v0", 3, TEST_SEED, "policy")
    three = load_pretrained("ThreeXReach-v0")  # of the same sizes
    with pytest.raises(ControllerError, match="made for another environment"):
        evaluate(three, "DualTriangleReachMuJoCo-v0", 3, TEST_SEED, "policy")
    with pytest.raises(TypeError, match="observation is ndarray: must be the environment's, a Dict"):
        policy.predict(np.zeros(16))
    with pytest.raises(TypeError, match="env_id = 5: must be an id"):
        load_pretrained(5)
    with pytest.raises(TypeError, match="options = 5: must be a dict"):
        load_pretrained("TwoXReach-v0", 5)
    with pytest.raises(ValueError, match="unexpected keyword argument 'x'; there are control"):
        load_pretrained("TwoXReach-v0", {"x": 1})
    with pytest.raises(ValueError, match="no policy is shipped for foo/TwoXReach-v0"):
        load_pretrained("foo/TwoXReach-v0")


@pytest.mark.parametrize(
    ("change", "state", "begins", "message"),
    [
        ({"achieved_goal": None}, None, None, "the observation has no achieved_goal"),
        (
            {"observation": np.zeros((2, 3))},
            None,
            None,
            r"observation of shape \(2, 3\): must be \(6,\), or n of these",
        ),
        ({"observation": np.zeros((2, 2, 6))}, None, None, r"observation of shape \(2, 2, 6\): must be"),
        ({"desired_goal": np.zeros((3, 2))}, None, None, "numbers of environments differ"),
        ({}, "ab", None, "state of type str: must be None, or what predict returned"),
        ({}, None, [True], "episode_start of size 1, but observations of 2"),
        ({}, 3, None, "state of 3 environments, but observations of 2"),
    ],
)
def test_what_a_policy_cannot_be_asked_is_explained(change, state, begins, message):
    policy, envs = load_pretrained(PAYLOAD), gym.make_vec(PAYLOAD, 3, vectorization_mode="vector_entry_point")
    seen, _ = envs.reset(seed=0)
    if state == 3:
        _, state = policy.predict(seen)
    asked = {key: value[:2] for key, value in seen.items()} | change
    asked = {key: value for key, value in asked.items() if value is not None}
    with pytest.raises((ValueError, TypeError), match=message):
        policy.predict(asked, state, begins)
    with pytest.raises(ValueError, match="the batch is empty"):
        policy.predict({key: value[:0] for key, value in seen.items()})
