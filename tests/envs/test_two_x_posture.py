"""What is particular to the environment of posture changes."""

import math

import gymnasium as gym
import numpy as np
import pytest

from baseline_runs import columns_of, of_group
from tensegrity_agents.controllers import make_controller
from tensegrity_envs import termination_reason
from tensegrity_envs.mechanics import FURET2018, MURALIDHARAN2022, TwoX

ENV = "tensegrity/TwoXPostureChange-v0"


def determinant(theta):
    """Det J with respect to theta by central differences of the tip of an arm with L = 1, b = 9/10."""
    arm, h = TwoX(FURET2018(0.9)), 1e-6

    def tip(t1, t2):
        return np.array(arm.tip((2 * t1, 2 * t2)))

    first = (tip(theta[0] + h, theta[1]) - tip(theta[0] - h, theta[1])) / (2 * h)
    second = (tip(theta[0], theta[1] + h) - tip(theta[0], theta[1] - h)) / (2 * h)
    return first[0] * second[1] - first[1] * second[0]


def test_goals_are_other_postures_of_the_same_tip_on_the_same_side_of_the_singularity():
    envs = gym.make_vec(ENV, 500, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    observation, info = envs.reset(seed=0)
    start, goal = (observation[key].T.astype(float) for key in ("achieved_goal", "desired_goal"))
    arm = TwoX(FURET2018(0.9))
    gap = np.hypot(*(np.array(arm.tip(tuple(2 * start))) - np.array(arm.tip(tuple(2 * goal)))))
    assert gap.max() < 2e-6  # goals are single precision
    assert (determinant(start) * determinant(goal) > 0).all()
    assert info["posture_error"].min() > 0.1
    assert np.abs(goal).max() <= math.pi + 1e-6
    assert len(np.unique(np.sign(determinant(start)))) == 2


def test_an_episode_ends_where_det_j_gets_small_or_changes_its_sign_and_only_there():
    envs = gym.make_vec(ENV, 64, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    observation, _ = envs.reset(seed=1)
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(60):
        before = observation["achieved_goal"].T.astype(float)
        action = np.sign(rng.uniform(-1, 1, (64, 2)))
        observation, _, terminated, _, info = envs.step(action)
        along = np.stack([determinant(before + 0.1 * action.T * t) for t in np.linspace(0, 1, 41)])
        lowest = (along * np.sign(along[0])).min(axis=0)
        assert not (terminated & (lowest > 2e-3)).any()
        assert not (~terminated & (lowest < -5e-3)).any()  # between two looks it may dip a little
        ended += terminated.sum()
        for i in np.flatnonzero(terminated):
            assert termination_reason(info["final_info"]["failure"])[i] == "singular"
    assert ended > 20


@of_group(ENV)
def test_the_planner_changes_postures_and_straight_paths_do_not():
    names = ("planner", "straight_path", "pseudo_inverse")
    shares = {name: columns_of(ENV, name)["success"].mean() for name in names}
    assert shares["planner"] >= 0.95
    assert shares["straight_path"] <= 0.2
    assert shares["pseudo_inverse"] == 0


def test_the_potential_rises_along_the_planners_way():
    env = gym.make(ENV)
    planner = make_controller("planner", ENV)
    for seed in range(5):
        observation, info = env.reset(seed=seed)
        planner.begin_episodes(np.ones(1, bool), env.unwrapped.design)
        values, ended, memory = [info["reward_potential"]], False, None
        start = np.ones(1, bool)
        while not ended and not info["is_success"]:
            action, memory = planner.predict({key: value[None] for key, value in observation.items()}, memory, start)
            start = np.zeros(1, bool)
            observation, _, terminated, truncated, info = env.step(action[0])
            ended = terminated or truncated
            values.append(info["reward_potential"])
        assert info["is_success"]
        assert values[-1] - values[0] > 0.1
        assert np.mean(np.diff(values) > -1e-3) > 0.8


def test_designs_that_cannot_be_used_are_refused():
    with pytest.raises(ValueError, match="offsets"):
        gym.make(ENV, design=MURALIDHARAN2022)
    with pytest.raises(ValueError, match="smallest"):
        gym.make(ENV, smallest=0.0)
