"""What is particular to the environments of the spatial prism."""

import gymnasium as gym
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensegrity_envs.mechanics import JAHROMY, SpatialPrism, SpatialPrismDesign
from tensegrity_envs.mechanics.spatial_prism import TRAJECTORIES

TRACK, PAYLOAD = (f"tensegrity/SpatialPrism{name}-v0" for name in ("Track", "PayloadTrack"))
PRISM = SpatialPrism()
CYCLE, RATE = 200, 0.015


def make_vec(env_id, count, **options):
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)


def imbalance(info, load):
    """Largest moment about the centroid left, and error of the struts' lengths, from node positions of every prism."""
    angles = np.array([0, 2, 4]) * np.pi / 3
    base, flat = (np.stack([np.cos(a), np.sin(a), 0 * a], axis=1) for a in (angles, angles + np.pi / 6))
    worst = error = 0.0
    for q, lengths, force in zip(info["configuration"], info["lengths"], load, strict=True):
        arms = Rotation.from_rotvec(q[3:]).apply(0.2 * flat)
        struts = q[:3] + arms[[1, 2, 0]] - 0.5 * base
        springs = 100.0 * (0.5 * base - q[:3] - arms)
        thrust = np.linalg.solve(struts.T, -springs.sum(axis=0) - force)[:, None] * struts
        moment = np.cross(arms[[1, 2, 0]], thrust).sum(axis=0) + np.cross(arms, springs).sum(axis=0)
        worst = max(worst, np.abs(moment).max())
        error = max(error, np.abs(np.linalg.norm(struts, axis=1) - lengths).max())
    return worst, error


@pytest.mark.parametrize("env_id", [TRACK, PAYLOAD])
def test_the_platform_is_in_equilibrium_under_lengths_and_load_after_every_step(env_id):
    envs = make_vec(env_id, 20)
    _, info = envs.reset(seed=0)
    rng = np.random.default_rng(0)
    for step in range(190):
        before = info["lengths"]
        _, _, terminated, truncated, info = envs.step(rng.uniform(-1, 1, (20, 3)))
        running = ~(terminated | truncated)
        assert (np.abs(info["lengths"] - before)[running] <= RATE + 1e-12).all()
        if step % 10 == 0:
            moment, error = imbalance(info, info.get("load", np.zeros((20, 3))))
            assert moment < 1e-8
            assert error < 1e-12
    if env_id == PAYLOAD:
        assert (info["load"][:, 2] < 0).sum() > 10


@pytest.mark.parametrize(("env_id", "payload"), [(TRACK, None), (PAYLOAD, (0.0, 0.5)), (PAYLOAD, (2.0, 4.0))])
def test_every_episode_can_be_solved(env_id, payload):
    """Loaded inverse kinematics at every step of 500 curves: within stroke, rates and wrench feasibility."""
    count = 500
    options = {} if payload is None else {"payload_range": payload}
    envs = make_vec(env_id, count, **options).unwrapped
    envs.reset(seed=77)
    episode = envs.episode
    time = np.arange(CYCLE + 1)[:, None]
    points = np.broadcast_arrays(*episode.goal_at(time))
    weight = np.zeros(count) if payload is None else episode.load[2]
    flat = [p.ravel() for p in points]
    found = PRISM.loaded_inverse_kinematics(flat, (0.0, 0.0, np.broadcast_to(weight, points[0].shape).ravel()))
    assert found.is_stable.all()
    assert np.min([*found.forces, *found.tensions]) > 0
    if payload != (2.0, 4.0):
        assert np.min(found.forces) > 50
        assert np.min(found.tensions) > 48
    lengths = np.stack(found.lengths).reshape(3, CYCLE + 1, count)
    assert lengths.min() >= 0.5
    assert lengths.max() <= 1.2
    assert np.abs(np.diff(lengths, axis=1)).max() <= RATE
    assert points[2].min() >= 0.2
    start = np.stack(PRISM.unloaded_lengths(tuple(p[0] for p in points)))
    # the payload is taken up within the same rates, whenever it comes
    if payload == (0.0, 0.5):
        unloaded = np.stack(PRISM.unloaded_lengths(tuple(flat))).reshape(lengths.shape)
        assert np.abs(lengths[:, 1:] - unloaded[:, :-1]).max() <= RATE
    np.testing.assert_allclose(start, PRISM.unloaded_lengths(tuple(p[0] for p in points)))


def test_published_trajectories_are_followed_at_the_published_shape():
    for name, trajectory in TRAJECTORIES.items():
        env = gym.make(TRACK, trajectory=name).unwrapped
        env.reset(seed=3)
        t = np.arange(0, CYCLE, 7)
        np.testing.assert_allclose(np.stack(env.episodes.goal_at(t[:, None]))[..., 0], trajectory(t / CYCLE), atol=1e-7)


@pytest.mark.parametrize(
    ("name", "rate", "loaded", "taken_up"), [("eq31", 8.15, 8.10, 8.62), ("eq32", 2.05, 2.02, 2.45)]
)
def test_rates_along_the_published_trajectories(name, rate, loaded, taken_up):
    """Largest length steps [mm] at 200 steps a cycle: unloaded, with 0.5 kg, and in the step that takes it up."""
    r = TRAJECTORIES[name](np.arange(CYCLE + 1) / CYCLE)
    plain = np.stack(PRISM.unloaded_lengths(r))
    heavy = np.stack(PRISM.loaded_inverse_kinematics(r, (0.0, 0.0, -0.5 * 9.81)).lengths)
    steps = [np.diff(plain), np.diff(heavy), heavy[:, 1:] - plain[:, :-1]]
    np.testing.assert_allclose([1e3 * np.abs(step).max() for step in steps], [rate, loaded, taken_up], atol=0.006)


def test_a_quarter_each_are_published_trajectories_begun_anywhere():
    envs = make_vec(TRACK, 2000).unwrapped
    envs.reset(seed=5)
    mean, motion = np.stack(envs.episode.goal), np.array(envs.episode.motion)
    still = (np.abs(motion[:, 2:]).max(axis=(0, 1)) < 1e-12) & (np.hypot(*mean[:2]) < 1e-12)
    for height, size in ((0.4, np.sqrt(0.1)), (0.7, 0.1)):
        mine = still & (np.abs(mean[2] - height) < 1e-12)
        assert 0.2 < mine.mean() < 0.3
        np.testing.assert_allclose(np.sqrt((motion[:, :2, mine] ** 2).sum(axis=(0, 1))), size, atol=1e-9)
        assert np.ptp(motion[1, 0, mine]) > 0.15
    assert 0.4 < (~still).mean() < 0.6


def follow(env, disturbed=()):
    """Lengths of the unloaded inverse kinematics one step ahead; at some steps, too long ones."""
    _, info = env.reset(seed=1)
    successes = []
    for step in range(2 * CYCLE):
        goal = env.unwrapped.episode.goal_at(step + 1.0)
        lengths = np.array(PRISM.unloaded_lengths(goal)) + (0.004 if step + 1 in disturbed else 0.0)
        _, _, terminated, truncated, info = env.step(np.clip((lengths - info["lengths"]) / RATE, -1, 1))
        assert not terminated
        successes.append(info["is_success"])
    assert truncated
    return successes, info


def test_success_is_the_second_cycle_within_tolerance_told_at_its_end():
    env = gym.make(TRACK)
    successes, info = follow(env)
    assert successes == [False] * (2 * CYCLE - 1) + [True]
    assert info["largest_error"] < 1e-6
    assert follow(env, disturbed=(30, CYCLE - 1))[0][-1]
    for late in (CYCLE, CYCLE + 100, 2 * CYCLE):
        successes, info = follow(env, disturbed=(late,))
        assert not any(successes)
        assert 0.002 < info["largest_error"] < 0.02


def test_the_payload_comes_unannounced_in_the_first_cycle():
    n = 300
    loaded, plain = (make_vec(PAYLOAD, n, **options) for options in ({}, {"payload_range": (0.0, 0.0)}))
    first, info = loaded.reset(seed=9)
    onset, payload = loaded.unwrapped.episode.onset, -loaded.unwrapped.episode.load[2] / 9.81
    assert onset.min() >= 0.1 * CYCLE
    assert onset.max() <= 0.9 * CYCLE
    assert payload.max() <= 0.5
    assert np.corrcoef(onset, payload)[0, 1] == pytest.approx(0, abs=0.15)
    other, _ = plain.reset(seed=9)
    for key, value in first.items():
        np.testing.assert_array_equal(value, other[key])
    for step in range(1, CYCLE):
        seen, _, terminated, _, info = loaded.step(np.zeros((n, 3)))
        np.testing.assert_allclose(info["load"][:, 2], np.where(step >= onset, -9.81 * payload, 0))
        other, *_ = plain.step(np.zeros((n, 3)))
        before = (step < onset) & ~terminated
        np.testing.assert_allclose(seen["observation"][before], other["observation"][before], atol=1e-7)
    sag = seen["achieved_goal"][:, 2] - other["achieved_goal"][:, 2]
    assert sag.max() <= 1e-7
    assert sag.min() < -5e-4


def test_the_observation_looks_ahead():
    envs = make_vec(PAYLOAD, 10).unwrapped
    observation, _ = envs.reset(seed=4)
    for _ in range(30):
        observation, *_, info = envs.step(np.zeros((10, 3)))
    episode, tip = envs.episode, observation["achieved_goal"].astype(float)
    assert observation["observation"].shape == (10, 18)
    for k, ahead in enumerate((1, 2, 5, 10)):
        part = observation["observation"][:, 6 + 3 * k : 9 + 3 * k].astype(float)
        goal = tip + part / (1 - np.abs(part)) * ahead * RATE
        np.testing.assert_allclose(goal.T, episode.goal_at(30.0 + ahead), atol=1e-6)
    np.testing.assert_allclose(observation["desired_goal"].T, episode.goal_at(30.0), atol=1e-7)
    np.testing.assert_allclose(observation["observation"][:, 3:6], (2 * info["lengths"] - 1.7) / 0.7, atol=1e-6)


def test_options_are_checked_and_other_designs_work():
    for options, message in (
        ({"trajectory": "circle"}, "circle.*eq31"),
        ({"cycle": 1}, "cycle"),
        ({"payload_range": (0.5, 0.1)}, "payload_range"),
    ):
        with pytest.raises(ValueError, match=message):
            gym.make(TRACK, **options)
    env = gym.make(TRACK, design=SpatialPrismDesign(0.37, 0.93, 310.0))
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    assert env.unwrapped.core.simulation.rate == pytest.approx(0.03 * 0.93)
    assert env.unwrapped.design != JAHROMY
    assert env.step(np.zeros(3))[1] > 0


def test_impossible_demands_are_an_error_that_says_what_to_change():
    with pytest.raises(RuntimeError, match="raise cycle"):
        gym.make(TRACK, cycle=10, trajectory="eq31").reset(seed=0)


def test_another_stiffness_moves_the_platform_as_another_payload_and_nothing_else():
    """Drawn prisms rest as prisms built so, and every curve is within reach of the prism that was drawn."""
    envs = make_vec(PAYLOAD, 200, randomization={"stiffness": (0.5, 2.0)}, payload_range=(2.0, 4.0))
    _, info = envs.reset(seed=0)
    episode, factor = envs.unwrapped.episode, info["random_stiffness"]
    np.testing.assert_array_equal(episode.design.k, 100.0 * factor)
    assert np.ptp(factor) > 1.0
    weight = -episode.load[2]
    for step in (0, 50, 130):
        place = tuple(episode.goal_at(np.full(200, float(step))))
        built = [SpatialPrism(SpatialPrismDesign(0.2, 0.5, k)) for k in episode.design.k[:20]]
        for i, prism in enumerate(built):
            here, load = tuple(c[i] for c in place), (0.0, 0.0, -weight[i])
            found = prism.loaded_inverse_kinematics(here, load)
            assert found.is_stable and min(found.lengths) >= 0.5 and max(found.lengths) <= 1.2
            assert min(found.forces) > 0 and min(found.tensions) > 0
            other = PRISM.loaded_inverse_kinematics(here, (0.0, 0.0, -weight[i] / factor[i]))
            np.testing.assert_allclose(other.lengths, found.lengths, atol=1e-9)
