"""What is particular to the environments of the dual-triangle arm."""

import gymnasium as gym
import numpy as np
import pytest
from scipy.stats import ks_2samp

from tensegrity_agents.controllers import make_controller
from tensegrity_agents.controllers.dual_triangle import ClosedFormSquares, PseudoInverse
from tensegrity_envs import termination_reason
from tensegrity_envs.mechanics import ZHAO2021_CAPTION, ZHAO2021_TEXT, DualTriangle, DualTriangleDesign

REACH, LOADED, PUSH = (f"tensegrity/DualTriangle{task}-v0" for task in ("Reach", "LoadedReach", "Push"))
OBSTACLES = "tensegrity/DualTriangleObstacleReach-v0"
KB = 500.0 * 0.05  # [N]
TAPERED = {
    "a1": (0.055, 0.05, 0.045),
    "b1": (0.05, 0.045, 0.04),
    "b2": 0.045,
    "k1": (700.0, 500.0, 300.0),
    "k2": (700.0, 500.0, 300.0),
    "free_length1": (0.06, 0.055, 0.05),
}


def make_vec(env_id, count, **options):
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)


def lengths_of(arm, info):
    """Free lengths, from the inputs that `info` tells."""
    if "free_lengths" in info:
        return tuple(info["free_lengths"].T)
    deltas = info["control_inputs"].T
    return tuple(arm.design.free_length1 + sign * delta for delta in deltas for sign in (-1, 1))


def balance(arm, q, lengths, load):
    """Largest sum of torques about a pivot, of everything beyond it: springs and load, from node positions alone [N m].

    Springs between a segment's own triangles act on both; the one that crosses the pivot counts.
    """
    nodes = arm.nodes(q)
    design, worst = arm.design, 0.0
    for i in range(arm.segments):
        ox, oy = nodes[f"O{i + 1}"]
        px, py = nodes["P"]
        torque = (px - ox) * load[1] - (py - oy) * load[0]
        for (base, moving), k, free in (
            ((f"A{i + 1}", f"D{i + 1}"), design.k1, lengths[2 * i]),
            ((f"B{i + 1}", f"C{i + 1}"), design.k2, lengths[2 * i + 1]),
        ):
            (bx, by), (mx, my) = nodes[base], nodes[moving]
            length = np.hypot(bx - mx, by - my) + 1e-300  # zero where the edges meet, as its free length is
            force = k * (length - free) / length
            torque = torque + (mx - ox) * force * (by - my) - (my - oy) * force * (bx - mx)
        worst = max(worst, float(np.abs(torque).max()))
    return worst


@pytest.mark.parametrize(
    ("env_id", "segments"), [(REACH, 3), (LOADED, 3), (PUSH, 3), (REACH, 2), (REACH, 5), (LOADED, 5), (LOADED, 2)]
)
def test_the_arm_is_in_stable_equilibrium_under_inputs_and_load_after_every_step(env_id, segments):
    envs = make_vec(env_id, 64, **({} if env_id == PUSH else {"segments": segments}))
    arm = DualTriangle(segments=segments)
    _, info = envs.reset(seed=0)
    name = envs.unwrapped.core.input_name
    rng = np.random.default_rng(0)
    scale = 0.03 if env_id == PUSH else 1.0  # larger moves lose the target at once
    for _ in range(60):
        before = info[name]
        _, _, terminated, truncated, info = envs.step(scale * rng.uniform(-1, 1, envs.action_space.shape))
        running = ~(terminated | truncated)
        q, load = tuple(info["configuration"].T), tuple(info["load"].T)
        assert balance(arm, q, lengths_of(arm, info), load) < 1e-9
        hessian = np.moveaxis(np.array(arm.stiffness_matrix(q, lengths_of(arm, info), load)), -1, 0)
        smallest = np.linalg.eigvalsh(hessian)[:, 0]
        assert smallest.min() > 0
        np.testing.assert_allclose(smallest / (500 * 0.05**2), info["stability_margin"], atol=1e-9)
        assert np.abs(info[name] - before)[running].max() <= 0.05 * 0.05 + 1e-12


def test_loads_are_as_large_as_promised_and_start_at_rest_under_them():
    envs = make_vec(LOADED, 2000)
    _, info = envs.reset(seed=5)
    size = np.hypot(*info["load"].T) / (0.1339745962155614 * KB)
    assert size.max() <= 1.5
    assert size.max() > 1.4
    assert size.min() < 0.1
    assert (
        balance(DualTriangle(), tuple(info["configuration"].T), lengths_of(DualTriangle(), info), info["load"].T) < 1e-9
    )


def test_every_loaded_episode_can_be_solved():
    """The walk's end is an equilibrium within all bounds; most can be reached by the straight way alone."""
    env = gym.make(LOADED).unwrapped
    sampler, core = env.core.sampler, env.core
    n = 40
    drawn = sampler.sample(np.arange(n), np.zeros(n, int))
    _, high = core.simulation.bounds(core.nominal)
    solved = 0
    for i in range(n):
        observation, info = env.reset(seed=i)
        np.testing.assert_allclose(info["configuration"], [q[i] for q in drawn.configuration], atol=1e-9)
        goal = np.array([q[i] for q in drawn.target_configuration])
        load = tuple(float(force[i]) for force in drawn.load)
        # The control law tells the inputs that hold the walk's end; straight there.
        end = np.array(core.nominal.control(tuple(goal), load))
        assert (np.abs(end) <= high + 1e-9).all()
        gradient = core.nominal.energy_gradient(tuple(goal), core.nominal.free_lengths(tuple(end)), load)
        assert np.abs(gradient).max() < 1e-9
        done = False
        for _ in range(80):
            gap = (end - info["control_inputs"]) / core.simulation.rate
            _, _, terminated, _, info = env.step(np.clip(gap, -1, 1))
            done = bool(info["is_success"])
            if terminated or done:
                break
        solved += done
        assert np.hypot(*(np.array(core.nominal.tip(tuple(goal))) - observation["desired_goal"])) < 1e-7
    assert solved >= 0.6 * n


def test_the_score_is_the_largest_force_held_in_critical_loads():
    env = gym.make(PUSH).unwrapped
    critical = 0.1339745962155614 * KB
    for seed in range(6):
        _, info = env.reset(seed=seed)
        held = 0.0
        for step in range(1, 151):
            _, reward, terminated, _, info = env.step(np.zeros(6))
            assert info["load"][0] == pytest.approx(-0.3 * KB * step / 150)
            assert info["load"][1] == 0
            if terminated:
                break
            held = -info["load"][0]
        assert terminated
        assert reward == 0
        assert termination_reason(info["failure"]) in ("off target", "buckled", "joint limit")
        assert info["score"] == pytest.approx(held / critical)
        assert bool(info["is_success"]) == (info["score"] >= 1)


def test_starts_for_holding_are_on_target_within_all_bounds_and_of_both_elbows():
    envs = make_vec(PUSH, 3000)
    observation, info = envs.reset(seed=1)
    x, y = observation["desired_goal"].T
    assert (y == 0).all()
    assert x.min() >= 0.25 - 1e-6
    assert x.max() <= 0.295 + 1e-6
    assert np.ptp(x) > 0.04
    assert info["tip_error"].max() < 1e-7
    assert (info["stability_margin"] > 0).all()
    assert (info["free_lengths"] >= 0).all()
    assert (info["free_lengths"] <= 0.075).all()
    up = (info["configuration"][:, 2] > 0).mean()
    assert 0.45 < up < 0.55
    # unloaded: each pair of springs balances about its own pivot
    assert balance(DualTriangle(), tuple(info["configuration"].T), tuple(info["free_lengths"].T), (0.0, 0.0)) < 1e-12


def test_starts_for_holding_are_as_likely_as_when_every_angle_is_tried():
    core = gym.make(PUSH).unwrapped.core
    drawn = core.sample(np.arange(20_000), np.zeros(20_000, int))
    angles = np.stack(drawn.configuration)
    # Rejection from all first angles and elbows, without the sampler's table, for the same targets.
    rng = np.random.default_rng(0)
    x = np.asarray(drawn.episode.goal[0])
    other = np.full((3, len(x)), np.nan)
    pending = np.arange(len(x))
    while len(pending):
        tries = rng.uniform(-0.95, 0.95, len(pending)), rng.choice([-1.0, 1.0], len(pending))
        *q, good = core.sampler.start(np.stack([x[pending], *tries]))
        other[:, pending[good > 0]] = np.stack(q)[:, good > 0]
        pending = pending[good == 0]
    for low in np.linspace(x.min(), x.max(), 6)[:-1]:
        part = (x >= low) & (x < low + np.ptp(x) / 5)
        for one, two in zip(angles[:, part], other[:, part], strict=True):
            assert ks_2samp(one, two).pvalue > 1e-4


@pytest.mark.parametrize("design", [ZHAO2021_CAPTION, ZHAO2021_TEXT], ids=["caption", "text"])
def test_targets_cover_the_workspace_and_are_reachable(design):
    envs = make_vec(REACH, 2000, design=design)
    observation, info = envs.reset(seed=2)
    target = observation["desired_goal"].T.astype(float)
    found = DualTriangle(design).redundancy(*target, (0.0, 0.0, 0.0), "squares")
    assert (found.is_reachable | (found.distance < 1e-6)).all()
    assert (np.abs(info["control_inputs"]) <= design.free_length1).all()
    assert np.ptp(target[0]) > 0.3
    assert np.ptp(target[1]) > 0.4


@pytest.mark.parametrize(("segments", "design"), [(2, None), (4, None), (5, None), (3, TAPERED)])
@pytest.mark.parametrize("maker", [PseudoInverse, ClosedFormSquares])
def test_an_arm_of_any_number_of_segments_reaches_its_targets(segments, design, maker):
    envs = make_vec(REACH, 32, segments=segments, design=design)
    core = envs.unwrapped.core
    arm = DualTriangle(core.design, segments)
    assert core.task.tolerance == pytest.approx(0.003 * arm.reach / DualTriangle().reach)
    assert envs.single_action_space.shape == (segments,)
    controller = maker(core)
    observation, info = envs.reset(seed=0)
    assert info["configuration"].shape == (32, segments)
    np.testing.assert_allclose(
        np.array(arm.tip(tuple(info["configuration"].T))).T, observation["achieved_goal"], atol=1e-7
    )
    reached, state = np.zeros(32, bool), None
    for step in range(80):
        action, state = controller.predict(observation, state, np.full(32, step == 0))
        observation, _, terminated, _, info = envs.step(action)
        reached |= np.asarray(info["is_success"], bool)
        if terminated.any():
            break
    assert reached.mean() >= 0.9


def test_targets_of_any_number_of_segments_can_be_chosen_and_those_out_of_reach_are_refused():
    for segments in (2, 3, 5):
        env = gym.make(REACH, segments=segments)
        target = (0.9 * env.unwrapped.core.reach, 0.01)
        observation, _ = env.reset(seed=0, options={"target": target})
        np.testing.assert_allclose(observation["desired_goal"], target, atol=1e-7)
        with pytest.raises(ValueError, match="out of reach of the arm within its joint limits"):
            env.reset(options={"target": (1.01 * env.unwrapped.core.reach, 0.0)})
    for wrong, error in ((1, ValueError), (2.5, TypeError), (True, TypeError)):
        with pytest.raises(error, match=f"segments = {wrong}"):
            gym.make(REACH, segments=wrong)
    with pytest.raises(TypeError, match="segments"):
        gym.make(PUSH, segments=5)
    with pytest.raises(ValueError, match="of three segments, not of 5"):
        make_controller("oracle", REACH, {"segments": 5})


@pytest.mark.parametrize(("segments", "design"), [(5, None), (3, TAPERED)])
def test_segments_settle_in_mujoco_where_they_are_in_equilibrium(segments, design):
    pytest.importorskip("mujoco")
    options = {"segments": segments, "design": design, "dynamics": {"joint_damping": 0.1}}
    env = gym.make("tensegrity/DualTriangleReachMuJoCo-v0", **options).unwrapped
    _, info = env.reset(seed=1)
    for step in range(1000):
        _, _, terminated, _, info = env.step(0.3 * (-1.0) ** np.arange(segments) * (step < 20))
        assert not terminated
    arm = DualTriangle(env.core.design, segments)
    lengths = arm.free_lengths(tuple(info["control_inputs"].tolist()))
    rest = arm.equilibrium(lengths, tuple(info["configuration"].tolist()))
    np.testing.assert_allclose(info["configuration"], rest.configuration, atol=1e-4)


@pytest.mark.parametrize("options", [{}, {"segments": 3, "obstacles": 2}, {"randomization": {"stiffness": (0.8, 1.2)}}])
def test_unequal_segments_in_a_vector_are_those_of_single_environments(options):
    env_id = OBSTACLES if "obstacles" in options else LOADED if options else REACH
    envs, singles = make_vec(env_id, 3, design=TAPERED, **options), []
    observations, _ = envs.reset(seed=3)
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (5, 3, 3)).astype(np.float32)
    for i in range(3):
        env = gym.make(env_id, design=TAPERED, **options)
        singles.append([env.reset(seed=3 + i)[0], *(env.step(action)[0] for action in actions[:, i])])
    stepped = [observations, *(envs.step(action)[0] for action in actions)]
    for k, observed in enumerate(stepped):
        for key, values in observed.items():
            np.testing.assert_array_equal(values, [single[k][key] for single in singles])


def test_designs_that_cannot_be_used_are_refused():
    with pytest.raises(ValueError, match="for 3 segments, not for 4: give segments=3"):
        gym.make(REACH, design=TAPERED, segments=4)
    with pytest.raises(ValueError, match="an arm of equal segments"):
        gym.make(PUSH, design=TAPERED)
    with pytest.raises(ValueError, match="not of links of different lengths; the closed forms"):
        make_controller("oracle", REACH, {"design": TAPERED})
    soft = DualTriangleDesign.symmetric(a=0.025, b=0.05, k=500.0, free_length=0.05)  # violates condition (2)
    with pytest.raises(ValueError, match="condition"):
        gym.make(REACH, design=soft)
    cables = DualTriangleDesign.symmetric(a=0.05, b=0.05, k=500.0, free_length=0.05, springs="cable")
    with pytest.raises(ValueError, match="bilateral"):
        gym.make(PUSH, design=cables)
    for env_id, options, name in (
        (LOADED, {"load_range": (1.0, 0.5)}, "load_range"),
        (LOADED, {"load_range": (0.0, float("inf"))}, "load_range"),
        (PUSH, {"load_per_step": 0.0}, "load_per_step"),
        (REACH, {"tolerance": 0.0}, "tolerance"),
    ):
        with pytest.raises(ValueError, match=name):
            gym.make(env_id, **options)
