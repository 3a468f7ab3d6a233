"""The environments of arms of X-joints: two joints are the 2-X, and every episode can be solved."""

from dataclasses import replace
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest

from tensegrity_envs.environments import NXReach, TwoXReach
from tensegrity_envs.mechanics import MURALIDHARAN2022, NX, THREE_X, NXDesign
from tensegrity_envs.vector_env import ManipulatorVectorEnv

COUNT = 64
TWO = NXDesign.from_two_x(MURALIDHARAN2022)
FOUR = replace(THREE_X, joints=4, k_left=(900.0, 600.0, 300.0, 300.0))


@pytest.mark.parametrize(
    "options",
    [
        {"control": "joint"},
        {"control": "tension"},
        {"control": "tension", "payload_range": [0.0, 0.4], "observe": "tip_and_inputs"},
        {"control": "tension", "randomization": {"stiffness": [0.9, 1.1], "mass": [0.9, 1.1]}},
    ],
)
def test_two_joints_are_the_2_x(options):
    one, other = (ManipulatorVectorEnv(arm, num_envs=COUNT, **more, **options) for arm, more in ARMS)
    (seen, _), (same, _) = one.reset(seed=3), other.reset(seed=3)
    rng = np.random.default_rng(0)
    for _ in range(30):
        for key, value in seen.items():
            np.testing.assert_allclose(same[key], value, rtol=0, atol=2e-6)
        action = rng.uniform(-1, 1, one.action_space.shape)
        seen, _, *ends, info = one.step(action)
        same, _, *other_ends, told = other.step(action)
        np.testing.assert_array_equal(ends, other_ends)
        for key in ("stability_margin", "wrench_margin", "tip_error"):
            np.testing.assert_allclose(told[key], info[key], rtol=0, atol=1e-9)


ARMS = ((TwoXReach, {}), (NXReach, {"design": TWO}))


def least_margin(design, start, end, looks=400):
    """On the straight joint paths from start to end, components of shape (n,)."""
    arm = NX(design)
    margins = []
    for t in np.linspace(0, 1, looks):
        q = tuple(a + t * (b - a) for a, b in zip(start, end, strict=True))
        _, stability, wrench = arm.posture(q)
        margins.append(np.minimum(stability, wrench))
    return np.min(margins, axis=0)


@pytest.mark.parametrize("routing", ["per_joint", "from_base"])
def test_targets_of_four_joints_can_be_reached_straight(routing):
    design = replace(FOUR, routing=routing)
    core = NXReach(design=design)
    sampled = core.sampler.sample(np.arange(COUNT), np.zeros(COUNT, int))
    assert (least_margin(core.design, sampled.configuration, sampled.target_configuration) > 0).all()
    tip = core.nominal.tip(sampled.target_configuration)
    goal = core.sample(np.arange(COUNT), np.zeros(COUNT, int)).episode.goal
    np.testing.assert_allclose(goal, tip, atol=1e-6)


def test_a_straight_or_planned_path_leads_to_every_target_of_three_joints():
    from tensegrity_agents.controllers.connecting import connect

    core = NXReach()
    sampled = core.sampler.sample(np.arange(1000), np.zeros(1000, int))
    start, end = np.stack(sampled.configuration, axis=1), np.stack(sampled.target_configuration, axis=1)
    straight = least_margin(core.design, sampled.configuration, sampled.target_configuration, 100) > 0
    assert 0.7 < straight.mean() < 1
    arm = NX(core.design)

    def is_free(q):
        _, stability, wrench = arm.posture(tuple(q))
        return (stability > 0) & (wrench >= 0) & (np.abs(q).max(axis=0) <= core.design.joint_limit)

    for i in np.flatnonzero(~straight):
        path = [start[i], *connect(is_free, start[i], end[i][None], core.design.joint_limit)]
        np.testing.assert_array_equal(path[-1], end[i])
        for a, b in pairwise(path):
            assert least_margin(core.design, tuple(a[:, None]), tuple(b[:, None]), 500) > 0


def test_designs_without_an_environment_are_explained():
    for fields, message in (
        ({"joints": 1, "k_left": 300.0}, "must be 2 or more"),
        ({"routing": [[1, 1, 1]]}, "must be 'per_joint' or 'from_base'"),
        ({"joints": 4}, "one number or 4 of them"),
        ({"joints": 4, "k_left": 300.0, "payload": 90.0}, "is empty"),
    ):
        with pytest.raises(ValueError, match=message):
            gym.make("tensegrity/ThreeXReach-v0", design=fields)


def test_a_target_can_be_chosen_where_a_posture_holds_it():
    env = gym.make("tensegrity/ThreeXReach-v0")
    observation, _ = env.reset(seed=0, options={"target": (0.3, 0.7)})
    np.testing.assert_allclose(observation["desired_goal"], (0.3, 0.7), atol=1e-6)
    with pytest.raises(ValueError, match="no stable, wrench-feasible configuration"):
        env.reset(options={"target": (0.0, -0.9)})
