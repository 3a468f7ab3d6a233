"""Environments among obstacles."""

import gymnasium as gym
import numpy as np
import pytest
import shapely

from obstacle_ids import IDS
from tensegrity_envs import termination_reason
from tensegrity_envs.environments import (
    DualTriangleObstacleReach,
    NXObstacleReach,
    PlanarFourBarObstacleReach,
    TwoXObstacleReach,
)
from tensegrity_envs.geometry.clearance import Disc, Polygon, Wall, bars_of, clearance
from tensegrity_envs.simulation.protocol import COLLISION, RUNNING

COUNT = 64
every_id = pytest.mark.parametrize("env_id", IDS)

DISC = {"centre": [0.4, 0.3], "radius": 0.06}
SQUARE = {"corners": [[-0.5, 0.3], [-0.4, 0.3], [-0.4, 0.4], [-0.5, 0.4]]}
WALL = {"point": [0.0, -0.2], "normal": [0.0, 3.0]}


def core_of(env_id):
    return gym.make(env_id).unwrapped.core


def gap_by_shapely(core, q, inputs, obstacles):
    """The distance of the arm in one state from discs, less their radii."""
    inputs = tuple(map(float, inputs)) if core.space.kept else None
    arm = shapely.MultiLineString(list(bars_of(core.nominal, tuple(map(float, q)), inputs).values()))
    return min(arm.distance(shapely.Point(one.centre)) - one.radius for one in obstacles)


def gaps(core, place, obstacles):
    """Clearances at coordinates (size, n) of the environment's space."""
    q, inputs = core.space.posture(tuple(place))
    return clearance(core.nominal, q, obstacles, inputs, core.own)


@every_id
def test_starts_keep_clear_and_say_how_far(env_id):
    env = gym.make(env_id).unwrapped
    for seed in range(20):
        observation, info = env.reset(seed=seed)
        discs = env.episode.obstacles
        seen = env.core.schema.decode({key: value[None] for key, value in observation.items()})
        expected = gap_by_shapely(env.core, info["configuration"], info[env.core.input_name], discs)
        assert info["clearance"] == pytest.approx(expected, abs=1e-9)
        assert info["clearance"] >= env.core.task.safe
        assert info["cost"] == 0
        assert env.scene().caption.endswith(f"clearance {env.core.error_text(info['clearance'])}")
        assert seen.clearance[0] == pytest.approx(info["clearance"], rel=1e-5)
        np.testing.assert_allclose(seen.obstacle_centres[0], np.ravel([one.centre for one in discs]), atol=1e-6)
        np.testing.assert_allclose(seen.obstacle_radii[0], [one.radius for one in discs], atol=1e-6)


@every_id
def test_the_straight_joint_path_is_cut_and_a_way_round_is_free(env_id):
    core = core_of(env_id)
    paths = []
    judge = core.surroundings._is_clear

    def watched(path, disc, held=None):
        good = judge(path, disc, held)
        if held is None:  # for the second and third disc: the paths that have been found
            paths.append(path)
        return good

    core.surroundings._is_clear = watched
    seeds = np.arange(COUNT)
    sampled = core.sample(seeds, np.zeros(COUNT, int))
    path = paths[0]
    np.testing.assert_array_equal(path.start, np.stack(core.space.ends(sampled, tuple(path.end))[0]))
    posture = [part for part in core.space.posture(tuple(path.end)) if part is not None]
    np.testing.assert_allclose(core.nominal.tip(*posture), sampled.episode.goal, atol=1e-6 * core.reach)
    discs = sampled.episode.obstacles
    for first, second in ((path.start, path.via), (path.via, path.end)):
        for share in np.linspace(0, 1, 301):
            place = first + share * (second - first)
            assert (gaps(core, place, discs) > 0).all()
            assert core.space.inside(core.nominal, np.zeros(COUNT, int), tuple(place)).all()
    straight = [gaps(core, path.start + share * (path.end - path.start), discs) for share in np.linspace(0, 1, 301)]
    assert (np.min(straight, axis=0) < 0).all()


@every_id
def test_touching_a_disc_ends_the_episode(env_id):
    envs = gym.make_vec(env_id, COUNT, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    envs.reset(seed=3)
    core, rng, seen = envs.unwrapped.core, np.random.default_rng(0), 0
    before, obstacles = None, envs.unwrapped.episode.obstacles
    drift = rng.uniform(-1, 1, envs.action_space.shape)
    for _ in range(100):
        _, reward, terminated, _, info = envs.step(drift.astype(np.float32))
        last = info.get("final_info", info)
        for i in np.flatnonzero(terminated):
            if termination_reason(last["failure"][i]) == "collision":
                seen += 1
                assert last["clearance"][i] <= 0
                assert last["cost"][i] == 1
                assert not last["is_success"][i]
                assert reward[i] == 0
                assert before is None or np.array_equal(last["configuration"][i], before[i])
                here = [Disc(tuple(float(x[i]) for x in one.centre), float(one.radius[i])) for one in obstacles]
                state = last["configuration"][i], last[core.input_name][i]
                assert gap_by_shapely(core, *state, here) > 0  # where the arm was before
        before, obstacles = info["configuration"], envs.unwrapped.episode.obstacles
    assert seen > 10


@every_id
def test_no_disc_is_passed_through_in_a_step(env_id):
    """Along random steps of full size, no look of twenty is deeper in a disc than those of the step said."""
    core = core_of(env_id)
    n = 400
    episodes, outcomes = core.begin(np.arange(n), np.zeros(n, int))
    rng = np.random.default_rng(1)
    discs = core.episodes.unpack(episodes).obstacles
    states = core.outcomes.unpack(outcomes).state
    for _ in range(8):
        actions = rng.choice([-1.0, 1.0], (core.simulation.action_size, n))
        outcomes = core.step(episodes, outcomes, actions)
        new = core.outcomes.unpack(outcomes).state
        going = new.failure == 0
        a, b = (np.stack(np.broadcast_arrays(*core.space.place(one))) for one in (states, new))
        least = np.min([gaps(core, a + s * (b - a), discs) for s in np.linspace(0, 1, 21)], axis=0)
        assert (least[going] > -0.012 * core.reach).all()
        assert (new.clearance[going] > 0).all()
        states = new


def test_obstacles_of_ones_own_are_in_every_episode():
    env = gym.make("tensegrity/ThreeXObstacleReach-v0", obstacles=[DISC, SQUARE, WALL]).unwrapped
    for seed in range(5):
        observation, info = env.reset(seed=seed)
        disc, square, wall = env.episode.obstacles
        assert (disc, square) == (Disc((0.4, 0.3), 0.06), Polygon(tuple(map(tuple, SQUARE["corners"]))))
        assert wall == Wall((0.0, -0.2), (0.0, 3.0))
        seen = env.core.schema.decode({key: value[None] for key, value in observation.items()})
        np.testing.assert_allclose(seen.obstacle_centres, [[0.4, 0.3]], atol=1e-6)
        q = tuple(info["configuration"])
        assert info["clearance"] == pytest.approx(clearance(env.core.nominal, q, [disc, square, wall]), abs=1e-9)
        assert min(y for _, y in env.core.nominal.nodes(q).values()) > -0.2
    assert len(env.scene().obstacles) == 3


def test_arrays_serve_as_lists_do():
    arrays = [{key: np.array(value) for key, value in one.items()} for one in (DISC, SQUARE, WALL)]
    wanted = TwoXObstacleReach(obstacles=[DISC, SQUARE, WALL])
    assert TwoXObstacleReach(obstacles=arrays).obstacles == wanted.obstacles
    made = [kind(**fields) for kind, fields in zip((Disc, Polygon, Wall), arrays, strict=True)]
    core = TwoXObstacleReach(obstacles=made)
    assert core.obstacles == wanted.obstacles
    starts = [one.sample(np.arange(2), np.zeros(2, int)).configuration for one in (core, wanted)]
    np.testing.assert_array_equal(*starts)


def test_walls_alone_are_not_observed():
    core = TwoXObstacleReach(obstacles=[Wall((-0.3, 0.0), (1.0, 0.0))])
    assert "obstacle_centres" not in core.schema.fields
    assert "clearance" in core.schema.fields


def test_the_cost_rises_where_it_is_not_safe():
    core = NXObstacleReach()
    rng = np.random.default_rng(0)
    n = 500
    episodes, outcomes = core.begin(np.arange(n), np.zeros(n, int))
    for _ in range(15):
        outcomes = core.step(episodes, outcomes, rng.uniform(-1, 1, (3, n)))
    told = core.outcomes.unpack(outcomes).info
    expected = np.clip(1 - told["clearance"] / (0.025 * core.reach), 0, 1)
    np.testing.assert_allclose(told["cost"], expected, atol=1e-12)
    assert ((expected > 0) & (expected < 1)).sum() > 5


def test_bad_obstacles_are_named():
    make = "tensegrity/ThreeXObstacleReach-v0"
    for given, message in (
        (0, "from 1 to 8 discs, or obstacles of your own, or 0 with own_bars=True"),
        (9, "from 1 to 8"),
        (True, "number of discs"),
        ("three", "number of discs"),
        ([], "number of discs"),
        ([3], r"obstacles\[0\] = 3"),
        ([DISC, {"centre": [0, 1]}], r"obstacles\[1\]"),
        ([DISC | {"colour": "red"}], "centre and radius"),
        ([DISC | {"radius": -1.0}], "positive radius"),
        ([DISC | {"radius": "big"}], r"obstacles\[0\] = .*: centre and radius must be numbers"),
        ([Disc((np.array([0.4, 0.5]), 0.3), 0.05)], "one disc, not many of them in arrays"),
        ([DISC | {"centre": [4.0, 0.0]}], "within the reach"),
    ):
        with pytest.raises(ValueError, match=message):
            gym.make(make, obstacles=given)
    with pytest.raises(ValueError, match="'quasi_static' alone; arms of X-joints and of dual-triangles"):
        PlanarFourBarObstacleReach(backend="mujoco")
    with pytest.raises(ValueError, match="from 1 to 8"):
        TwoXObstacleReach(obstacles=0)
    with pytest.raises(ValueError, match="own_bars = 'yes'"):
        TwoXObstacleReach(own_bars="yes")
    with pytest.raises(TypeError, match=r"'obstacles'.*it is an option of arm='NXObstacleReach'"):
        gym.make("tensegrity/ThreeXTensionReachMuJoCo-v0", obstacles=2)
    with pytest.raises(ValueError, match="no load"):
        gym.make("tensegrity/DualTriangleObstacleReach-v0", load_range=(0.0, 1.0))
    walls = [Wall((0.0, 0.1), (0.0, -1.0)), Wall((0.0, -0.1), (0.0, 1.0))]
    for given in (walls, [{"centre": (0.0, 0.0), "radius": 0.1}]):
        with pytest.raises(ValueError, match="obstacles: those given leave no start and target that can be reached"):
            gym.make(make, obstacles=given).reset(seed=0)


def test_a_start_in_an_obstacle_is_refused():
    env = gym.make("tensegrity/ThreeXObstacleReach-v0", obstacles=[DISC]).unwrapped
    env.reset(seed=0)
    env.reset(options={"configuration": (0.3, 0.2, 0.1)})
    with pytest.raises(ValueError, match="touches an obstacle"):
        env.reset(options={"configuration": (-0.9, 0.0, 0.0)})


ARMS = {
    "two_x": (TwoXObstacleReach, {"obstacles": 1}),
    "three_x": (NXObstacleReach, {"obstacles": 0}),
    "five_triangles": (DualTriangleObstacleReach, {"obstacles": 1, "segments": 5}),
    "four_bar": (PlanarFourBarObstacleReach, {"obstacles": 0}),
}


@every_id
def test_a_target_in_an_obstacle_is_refused_and_nothing_changes(env_id):
    env = gym.make(env_id)
    observation, _ = env.reset(seed=3)
    core = env.unwrapped.core
    sampled = core.sample(np.array([3]), np.array([0]))
    disc = sampled.episode.obstacles[1]
    x, y, radius = (float(value[0]) for value in (*disc.centre, disc.radius))
    inside = (x + 0.9 * radius, y)
    with pytest.raises(ValueError, match=r"target.* inside obstacle 1, a disc of radius .* its own target") as caught:
        env.reset(options={"target": inside, "episode": 0})
    named = str(caught.value).split("its own target (")[1].split(")")[0]
    np.testing.assert_allclose([float(part) for part in named.split(",")], observation["desired_goal"][:2], atol=1e-4)
    other = gym.make(env_id)
    other.reset(seed=3)
    for one in (env, other):  # the refused call left the stream where it was
        again, told = one.reset()
        if one is env:
            first, first_told = again, told
    np.testing.assert_array_equal(first["observation"], again["observation"])
    assert first_told["clearance"] == told["clearance"]
    chosen, _ = env.reset(options={"target": tuple(observation["desired_goal"]), "episode": 0})
    np.testing.assert_allclose(chosen["desired_goal"], observation["desired_goal"], atol=1e-6)
    vector = gym.make_vec(env_id, 2, vectorization_mode="vector_entry_point")
    with pytest.raises(ValueError, match="reset options"):
        vector.reset(options={"target": inside})


def test_a_target_in_an_obstacle_of_ones_own_is_refused():
    env = gym.make("tensegrity/ThreeXObstacleReach-v0", obstacles=[DISC, SQUARE, WALL])
    for k, place in enumerate(((0.41, 0.31), (-0.45, 0.35), (0.1, -0.21))):
        with pytest.raises(ValueError, match=f"inside obstacle {k}, .*outside of all 3 obstacles"):
            env.reset(seed=0, options={"target": place})


@pytest.mark.parametrize("name", ARMS)
def test_own_bars_that_meet_are_a_collision(name):
    """Under random actions the clearance is that of obstacles and own bars, and no state has crossed bars."""
    kind, options = ARMS[name]
    core, n, rng = kind(**options, own_bars=True), 100, np.random.default_rng(1)
    episodes, outcomes = core.begin(np.arange(n), np.zeros(n, int))
    discs, state = core.episodes.unpack(episodes).obstacles, core.outcomes.unpack(outcomes).state
    drift, met = rng.uniform(-1, 1, (core.simulation.action_size, n)), 0
    for _ in range(40):
        assert (gaps(core, core.space.place(state), discs) > 0).all()
        outcomes = core.step(episodes, outcomes, drift)
        before, state = state, core.outcomes.unpack(outcomes).state
        hit = state.failure == COLLISION
        running = state.failure == RUNNING
        assert (state.clearance[running] <= gaps(core, core.space.place(state), discs)[running] + 1e-12).all()
        np.testing.assert_array_equal(np.stack(state.configuration)[:, hit], np.stack(before.configuration)[:, hit])
        met += hit.sum()
    assert met > 0


def test_dynamics_among_obstacles():
    """In MuJoCo the clearance is that of the arm where it is measured, and a collision ends the episode."""
    make = {"arm": "NXObstacleReach", "obstacles": 3, "own_bars": True}
    env = gym.make("tensegrity/ThreeXTensionReachMuJoCo-v0", **make).unwrapped
    rng, seen = np.random.default_rng(0), 0
    for seed in range(4):
        env.reset(seed=seed)
        action, terminated = rng.uniform(-1, 1, env.action_space.shape).astype(np.float32), False
        for _ in range(60):
            _, reward, terminated, _, info = env.step(action)
            here = clearance(env.core.nominal, tuple(info["configuration"]), env.episode.obstacles, None, env.core.own)
            if terminated:
                break
            assert 0 < info["clearance"] <= here + 1e-12
        if terminated and termination_reason(info["failure"]) == "collision":
            seen += 1
            assert info["clearance"] <= 0 < here
            assert reward == 0
    assert seen > 0
