"""What is particular to the 2-X environments."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from scipy import ndimage

from tensegrity_envs import termination_reason
from tensegrity_envs.environments.two_x.sampling import Sampler
from tensegrity_envs.mechanics import MURALIDHARAN2022, TwoX
from tensegrity_envs.seeding import uniform

PAYLOAD = "tensegrity/TwoXPayloadReach-v0"


def test_joint_steps_are_at_most_a_tenth_of_a_radian_and_saturate_at_the_limits():
    env = gym.make("tensegrity/TwoXReach-v0").unwrapped
    for seed in range(20):
        _, info = env.reset(seed=seed)
        q = info["configuration"]
        _, _, terminated, _, info = env.step([1.0, -1.0])
        if not terminated:
            np.testing.assert_allclose(info["configuration"], np.clip(q + np.array([0.1, -0.1]), -2.6, 2.6), atol=1e-12)
            np.testing.assert_allclose(
                info["tensions"], TwoX(env.design).stiffest_tensions(info["configuration"]), atol=1e-9
            )


def test_the_arm_is_in_stable_equilibrium_under_its_actual_tensions_after_every_step():
    for env_id in ("tensegrity/TwoXTensionReach-v0", PAYLOAD):
        envs = gym.make_vec(env_id, 128, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
        _, info = envs.reset(seed=0)
        rng = np.random.default_rng(0)
        for _ in range(60):
            before = info["tensions"]
            _, _, terminated, truncated, info = envs.step(rng.uniform(-1, 1, (128, 4)))
            running = ~(terminated | truncated)
            q, tensions = tuple(info["configuration"].T), tuple(info["tensions"].T)
            arm = TwoX(envs.unwrapped.episode.design)
            gradient = np.hypot(*arm.energy_gradient(q, tensions))
            assert gradient.max() < 1e-9
            assert (arm.stability_margin(q, tensions) > 0).all()
            np.testing.assert_allclose(arm.stability_margin(q, tensions), info["stability_margin"], atol=1e-9)
            assert np.abs(info["tensions"] - before)[running].max() <= 15 + 1e-9


def test_a_buckling_arm_is_left_where_it_was_last_stable():
    """Against a reference that walks the same tension path in 2,000 steps with plain Newton."""
    env = gym.make("tensegrity/TwoXTensionReach-v0").unwrapped
    seen = 0
    for seed in range(12):
        _, info = env.reset(seed=seed)
        action = np.random.default_rng(seed).choice([-1.0, 1.0], 4)
        for _ in range(40):
            q, tensions = info["configuration"], info["tensions"]
            _, _, terminated, _, info = env.step(action)
            if terminated:
                break
        if termination_reason(info["failure"]) != "buckled":
            continue
        seen += 1
        arm, end = TwoX(env.design), np.clip(tensions + 15 * action, 5, 155)
        reached = 0.0
        for t in np.linspace(0, 1, 2001)[1:]:
            p = q.copy()
            for _ in range(8):
                g, h = arm.statics(tuple(p), tuple(tensions + t * (end - tensions)))
                p = p - np.linalg.solve(np.array(h), np.array(g))
            if np.abs(p - q).max() > 0.15 or np.linalg.eigvalsh(np.array(h))[0] <= 0:
                break
            q, reached = p, t
        ours = (info["tensions"] - tensions)[np.abs(end - tensions) > 1] / (end - tensions)[np.abs(end - tensions) > 1]
        assert reached < 1
        np.testing.assert_allclose(ours, reached, atol=2 / 256)
    assert seen >= 3


def test_starts_and_targets_are_members_by_an_independent_check():
    """Forces by linear algebra on node geometry, stability by finite differences of the energy, connection by flood
    fill.
    """
    sampler = Sampler(replace(MURALIDHARAN2022, joint_limit=2.6), (0.0, 0.4))
    n = 150
    drawn = sampler.sample(np.arange(n), np.zeros(n, int))
    payloads = drawn.mechanism.design.payload
    assert payloads.min() >= 0
    assert payloads.max() <= 0.4
    assert np.ptp(payloads) > 0.3
    for i in range(0, n, 5):
        arm = TwoX(replace(MURALIDHARAN2022, payload=float(payloads[i]), joint_limit=2.6))
        for q in (np.array([c[i] for c in drawn.configuration]), np.array([c[i] for c in drawn.target_configuration])):
            assert _held_stably(arm, q)
        axis = np.linspace(-2.6, 2.6, 401)
        pieces, _ = ndimage.label(arm.is_stable_wrench_feasible(tuple(np.meshgrid(axis, axis, indexing="ij"))))
        start, target = (
            tuple(int(np.argmin(np.abs(axis - c[i]))) for c in q)
            for q in (drawn.configuration, drawn.target_configuration)
        )
        assert pieces[start] == pieces[target] > 0


def _held_stably(arm, q):
    """Brute force over the tensions of each joint: some pair within bounds holds q, and the stiffest such is stable."""
    zero = (0.0, 0.0, 0.0, 0.0)
    step = 1e-5

    def slope(function, k):
        moved = [q.copy(), q.copy()]
        moved[0][k] += step
        moved[1][k] -= step
        return (function(moved[0]) - function(moved[1])) / (2 * step)

    tensions = []
    for joint in (0, 1):
        passive = slope(lambda p: arm.potential_energy(p, zero), joint)
        left, right = (slope(lambda p, k=2 * joint + side: arm.cable_lengths(p)[k], joint) for side in (0, 1))
        f_left = np.linspace(5, 155, 3001)
        f_right = -(passive + f_left * left) / right
        allowed = (f_right >= 5) & (f_right <= 155)
        if not allowed.any():
            return False
        best = np.flatnonzero(allowed)[np.argmax((f_left + f_right)[allowed])]
        tensions += [f_left[best], f_right[best]]
    h = np.zeros((2, 2))
    e = np.eye(2) * 1e-4

    def energy(p):
        return arm.potential_energy(p, tensions)

    for i in (0, 1):
        for j in (0, 1):
            h[i, j] = (
                energy(q + e[i] + e[j]) - energy(q + e[i] - e[j]) - energy(q - e[i] + e[j]) + energy(q - e[i] - e[j])
            ) / 4e-8
    return bool(np.linalg.eigvalsh(h)[0] > 0)


def test_the_start_does_not_give_the_payload_away():
    """Tensions and payload of the start are independent: no rank correlation in 3,000 episodes, and the same
    tensions for any payload.
    """
    sampler = Sampler(replace(MURALIDHARAN2022, joint_limit=2.6), (0.0, 0.4))
    n = 3000
    drawn = sampler.sample(np.arange(n), np.ones(n, int))
    rank = np.argsort(np.argsort(drawn.mechanism.design.payload))
    for tension in drawn.tensions:
        assert abs(np.corrcoef(rank, np.argsort(np.argsort(tension)))[0, 1]) < 4 / np.sqrt(n)


def test_payload_observation_hides_angles_margins_and_payload():
    env = gym.make(PAYLOAD)
    observation, info = env.reset(seed=0)
    assert observation["observation"].shape == (6,)
    design = env.unwrapped.design
    tip, tensions = observation["observation"][:2], observation["observation"][2:]
    np.testing.assert_allclose(tip * env.unwrapped.core.reach, observation["achieved_goal"], atol=1e-6)
    np.testing.assert_allclose(
        (tensions + 1) / 2 * (design.max_tension - design.min_tension) + 5, info["tensions"], atol=1e-4
    )
    assert design.payload == 0
    assert env.unwrapped.episode.design.payload == info["payload"] > 0


def test_every_environment_of_a_batch_has_its_own_payload():
    envs = gym.make_vec(PAYLOAD, 8, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    _, info = envs.reset(seed=0)
    assert len(set(info["payload"])) == 8
    np.testing.assert_array_equal(envs.unwrapped.episode.design.payload, info["payload"])


def test_an_arm_of_ones_own():
    design = replace(MURALIDHARAN2022, a=0.1, k1=400.0, max_tension=200.0, joint_limit=1.5)
    env = gym.make("tensegrity/TwoXTensionReach-v0", design=design)
    _, info = env.reset(seed=0)
    assert np.abs(info["configuration"]).max() <= 1.5
    with pytest.raises(ValueError, match="empty"):
        gym.make("tensegrity/TwoXReach-v0", design=replace(MURALIDHARAN2022, k1=50.0, k2=25.0, max_tension=20.0))


def test_random_numbers_are_uniform_and_independent_of_the_batch():
    seeds, episodes = np.arange(20000) % 200, np.arange(20000) // 200
    u = uniform(seeds, episodes, 3)
    assert abs(u.mean() - 0.5) < 0.01
    assert abs(u.var() - 1 / 12) < 0.003
    assert abs(np.corrcoef(u, uniform(seeds, episodes, 4))[0, 1]) < 0.03
    assert abs(np.corrcoef(u[:-1], u[1:])[0, 1]) < 0.03
    assert uniform(seeds[7:8], episodes[7:8], 3)[0] == u[7]
    assert len(np.unique(u)) == len(u)
