"""What is particular to the environments of the planar 4-bar mechanism."""

import math

import gymnasium as gym
import numpy as np
import pytest

from tensegrity_envs import termination_reason
from tensegrity_envs.mechanics import JI2014, PlanarFourBar, PlanarFourBarDesign
from tensegrity_envs.vector_env import step_info

REACH, LOADED = "tensegrity/PlanarFourBarReach-v0", "tensegrity/PlanarFourBarLoadedReach-v0"
ARM = PlanarFourBar()
KL = JI2014.stiffness * JI2014.length


def make_vec(env_id, count, **options):
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)


def node_slopes(q, lengths, load):
    """Gradient of the energy in theta and gamma by differences of node positions."""

    def energy(p):
        nodes = ARM.nodes(p, lengths)
        total = -load[0] * nodes["F"][0] - load[1] * nodes["F"][1]
        for first, second in ("CE", "EF", "DF"):
            (x1, y1), (x2, y2) = nodes[first], nodes[second]
            total = total + JI2014.stiffness * ((x1 - x2) ** 2 + (y1 - y2) ** 2) / 2
        return total

    h = 1e-3
    slopes = []
    for i in range(2):
        steps = [energy(tuple(a + m * h * (i == j) for j, a in enumerate(q))) for m in (1, -1, 2, -2)]
        slopes.append((8 * (steps[0] - steps[1]) - (steps[2] - steps[3])) / (12 * h))
    return np.array(slopes)


@pytest.mark.parametrize("env_id", [REACH, LOADED])
def test_the_mechanism_is_in_stable_equilibrium_after_every_step(env_id):
    envs = make_vec(env_id, 64)
    _, info = envs.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(100):
        before = info["actuator_lengths"].copy()
        _, _, terminated, truncated, info = envs.step(rng.uniform(-1, 1, envs.action_space.shape))
        running = ~(terminated | truncated)
        q, lengths = tuple(info["configuration"].T), tuple(info["actuator_lengths"].T)
        load = tuple(info["load"].T)
        assert np.abs(node_slopes(q, lengths, load)).max() < 1e-6 * KL
        hessian = np.moveaxis(np.array(ARM.stiffness_matrix(q, lengths, load)), -1, 0)
        smallest = np.linalg.eigvalsh(hessian)[:, 0] / (KL * JI2014.length)
        assert smallest.min() > 0
        np.testing.assert_allclose(smallest, info["stability_margin"], atol=1e-9)
        thrusts = np.abs(np.array(ARM.thrusts(q, lengths, load)))
        np.testing.assert_allclose(1 - thrusts.max(axis=0) / (2 * KL), info["wrench_margin"], atol=1e-9)
        assert thrusts.max() <= 2 * KL
        assert np.abs(info["actuator_lengths"] - before)[running].max() <= 0.5 + 1e-12


def test_the_unloaded_rectangle_stays_on_its_side_and_fails_where_it_is_singular():
    envs = make_vec(REACH, 256)
    _, info = envs.reset(seed=1)
    sides = ARM.side_of(tuple(info["configuration"].T), tuple(info["actuator_lengths"].T))
    assert set(sides.tolist()) == {-1, 1}
    rng = np.random.default_rng(1)
    drift = rng.choice([-1.0, 1.0], (256, 2))
    failed = 0
    for _ in range(99):
        _, _, terminated, _, info = envs.step(np.clip(drift + 0.5 * rng.normal(size=(256, 2)), -1, 1))
        last = step_info(info)
        here = ARM.side_of(tuple(last["configuration"].T), tuple(last["actuator_lengths"].T))
        same = here == sides
        assert same[terminated].all()
        assert set(termination_reason(last["failure"])[terminated]) <= {"singular"}
        assert (last["stability_margin"][terminated] < 0.02).all()
        failed += terminated.sum()
        now = ARM.side_of(tuple(info["configuration"].T), tuple(info["actuator_lengths"].T))
        assert (now == sides)[~terminated].all()
        sides = now
    assert failed > 50


def test_forces_are_as_large_as_promised_and_are_not_observed():
    envs = make_vec(LOADED, 2000)
    observation, info = envs.reset(seed=5)
    size = np.hypot(*info["load"].T)
    assert size.max() <= 200
    assert size.max() > 198
    assert size.min() < 2
    angle = np.arctan2(*info["load"].T)
    assert np.histogram(angle, 8, (-math.pi, math.pi))[0].min() > 150
    assert observation["observation"].shape == (2000, 4)  # tip and lengths
    q, lengths, load = (tuple(info[name].T) for name in ("configuration", "actuator_lengths", "load"))
    assert np.abs(node_slopes(q, lengths, load)).max() < 1e-6 * KL
    assert not make_vec(REACH, 3).reset(seed=0)[1]["load"].any()


def test_every_loaded_episode_is_solved_by_the_walk_that_drew_its_target():
    """The end of the walk is one of the loaded inverse solutions, and the straight way there is mostly stable."""
    env = gym.make(LOADED).unwrapped
    solved, count = 0, 40
    for seed in range(count):
        observation, info = env.reset(seed=seed)
        x, y = (float(v) for v in observation["desired_goal"])
        ends = [s.lengths for s in ARM.inverse_kinematics(x, y, tuple(info["load"])) if s.is_stable]
        # a target on a fold may be lost by its rounding to single precision
        done = False
        for end in ends:
            env.reset(seed=seed)
            for _ in range(80):
                gap = (np.array(end) - info["actuator_lengths"]) / env.core.simulation.rate
                _, _, terminated, _, info = env.step(np.clip(gap, -1, 1))
                done = bool(info["is_success"])
                if terminated or done:
                    break
            if done:
                break
            _, info = env.reset(seed=seed)
        solved += done
    assert solved >= 0.7 * count


def test_unloaded_targets_have_a_rectangle_on_the_side_of_the_start():
    envs = make_vec(REACH, 500)
    observation, info = envs.reset(seed=2)
    sides = ARM.side_of(tuple(info["configuration"].T), tuple(info["actuator_lengths"].T))
    missing = 0
    for (x, y), side in zip(observation["desired_goal"].astype(float), sides, strict=True):
        missing += not any(s.type == "X" and s.side == side for s in ARM.inverse_kinematics(x, y))
    assert missing <= 2  # on a fold, by rounding to single precision
    assert np.ptp(observation["desired_goal"][:, 0]) > 25
    assert np.ptp(observation["desired_goal"][:, 1]) > 19


def test_the_potential_falls_with_the_way_to_the_nearest_solution():
    env = gym.make(REACH).unwrapped
    weight = env.core.task.weights.potential
    free = 0
    for seed in range(30):
        observation, info = env.reset(seed=seed)
        here = np.asarray(info["actuator_lengths"])
        side = int(ARM.side_of(tuple(info["configuration"]), tuple(here)))
        assert side == info["random_side"]
        x, y = (float(v) for v in observation["desired_goal"])
        ends = [s.lengths for s in ARM.inverse_kinematics(x, y) if s.type == "X" and s.side == side]
        ends = [end for end in ends if 2 * min(ARM.flatness(end)) > 0.09]
        straight = min(np.hypot(*np.subtract(end, here)) for end in ends)
        found = info["reward_potential"]
        assert found <= weight * (1 - straight / 25) + 1e-9
        # Where C and D meet is not in the way of any solution: the nearest is straight ahead.
        t = np.linspace(0, 1, 200)[:, None]
        if all(np.hypot(*(here + t * np.subtract(end, here) - 10.0).T).min() > 2.75 for end in ends):
            assert found == pytest.approx(weight * (1 - straight / 25), abs=1e-9)
            free += 1
    assert free > 10


def test_a_mechanism_of_another_size_is_the_same_but_for_scale():
    small = gym.make(REACH, design=PlanarFourBarDesign(1.0, 30.0), tolerance=0.005).unwrapped
    large = gym.make(REACH).unwrapped
    a, _ = small.reset(seed=4)
    b, _ = large.reset(seed=4)
    rng = np.random.default_rng(4)
    for _ in range(30):
        action = rng.uniform(-1, 1, 2)
        (a, reward_a, end_a, *_), (b, reward_b, end_b, *_) = small.step(action), large.step(action)
        np.testing.assert_allclose(10 * a["achieved_goal"], b["achieved_goal"], atol=1e-5)
        assert reward_a == pytest.approx(reward_b, abs=1e-5)
        assert end_a == end_b
        if end_a:
            break


def test_options_that_cannot_be_used_are_refused():
    for options, name in (
        ({"load_range": (0.3, 0.1)}, "load_range"),
        ({"load_range": (0.0, math.inf)}, "load_range"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"reward_weights": {"effort": -1.0}}, "effort"),
    ):
        with pytest.raises(ValueError, match=name):
            gym.make(LOADED, **options)
    with pytest.raises(ValueError, match="batch"):
        gym.make(REACH, design=PlanarFourBarDesign(np.ones(2), 100.0))


def test_another_stiffness_is_another_force_and_nothing_else():
    """Drawn mechanisms begin in equilibrium, and the lengths that solve an episode do so with their own stiffness."""
    core = make_vec(LOADED, 1, randomization={"stiffness": (0.5, 2.0)}).unwrapped.core
    seed = np.arange(300)
    sampled, lengths = core.solved(seed, 0 * seed)
    factor, episode = sampled.episode.random["stiffness"], sampled.episode
    assert np.ptp(factor) > 1.0
    np.testing.assert_array_equal(episode.design.stiffness, factor * JI2014.stiffness)
    own = PlanarFourBar(episode.design)
    gradient = own.energy_gradient(sampled.configuration, sampled.inputs, episode.load)
    assert np.abs(np.array(gradient)).max() < 1e-6 * KL
    assert (own.stability_margin(sampled.configuration, sampled.inputs, episode.load) > 0).all()
    for i in range(0, 300, 10):
        built = PlanarFourBar(PlanarFourBarDesign(JI2014.length, float(episode.design.stiffness[i])))
        found = built.inverse_kinematics(*(float(c[i]) for c in episode.goal), tuple(float(f[i]) for f in episode.load))
        there = np.array([lengths[0][i], lengths[1][i]])
        assert min(np.abs(np.subtract(s.lengths, there)).max() for s in found if s.is_stable) < 1e-3
