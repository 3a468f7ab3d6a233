"""Environments among obstacles."""

import gymnasium as gym
import numpy as np
import pytest
import shapely

import tensegrity_envs
from tensegrity_envs import termination_reason
from tensegrity_envs.environments import NXObstacleReach, TwoXObstacleReach
from tensegrity_envs.geometry.clearance import Disc, Polygon, Wall, bars_of, clearance

IDS = [env_id for env_id in tensegrity_envs.ENV_IDS if "Obstacle" in env_id]
COUNT = 64
every_id = pytest.mark.parametrize("env_id", IDS)

DISC = {"centre": [0.4, 0.3], "radius": 0.06}
SQUARE = {"corners": [[-0.5, 0.3], [-0.4, 0.3], [-0.4, 0.4], [-0.5, 0.4]]}
WALL = {"point": [0.0, -0.2], "normal": [0.0, 3.0]}


def core_of(env_id):
    return gym.make(env_id).unwrapped.core


def gap_by_shapely(core, q, obstacles):
    """The distance of the arm in one configuration from discs, less their radii."""
    arm = shapely.MultiLineString(list(bars_of(core.nominal, tuple(map(float, q))).values()))
    return min(arm.distance(shapely.Point(one.centre)) - one.radius for one in obstacles)


@every_id
def test_starts_keep_clear_and_say_how_far(env_id):
    env = gym.make(env_id).unwrapped
    for seed in range(20):
        observation, info = env.reset(seed=seed)
        discs = env.episode.obstacles
        seen = env.core.schema.decode({key: value[None] for key, value in observation.items()})
        assert info["clearance"] == pytest.approx(gap_by_shapely(env.core, info["configuration"], discs), abs=1e-9)
        assert info["clearance"] >= env.core.task.safe
        assert info["cost"] == 0
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
    np.testing.assert_array_equal(path.start, np.stack(sampled.configuration))
    np.testing.assert_allclose(core.nominal.tip(tuple(path.end)), sampled.episode.goal, atol=1e-6)
    discs = sampled.episode.obstacles
    for first, second in ((path.start, path.via), (path.via, path.end)):
        for share in np.linspace(0, 1, 301):
            q = tuple(first + share * (second - first))
            assert (clearance(core.nominal, q, discs) > 0).all()
            assert core.sampler.inside(core.nominal, q).all()
    straight = [
        clearance(core.nominal, tuple(path.start + share * (path.end - path.start)), discs)
        for share in np.linspace(0, 1, 301)
    ]
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
                assert gap_by_shapely(core, last["configuration"][i], here) > 0  # where the arm was before
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
        a, b = np.stack(states.configuration), np.stack(new.configuration)
        least = np.min([clearance(core.nominal, tuple(a + s * (b - a)), discs) for s in np.linspace(0, 1, 21)], axis=0)
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
    assert TwoXObstacleReach(obstacles=arrays).obstacles == TwoXObstacleReach(obstacles=[DISC, SQUARE, WALL]).obstacles


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
        (0, "from 1 to 8"),
        (True, "number of discs"),
        ("three", "number of discs"),
        ([], "number of discs"),
        ([3], r"obstacles\[0\] = 3"),
        ([DISC, {"centre": [0, 1]}], r"obstacles\[1\]"),
        ([DISC | {"colour": "red"}], "centre and radius"),
        ([DISC | {"radius": -1.0}], "positive radius"),
        ([DISC | {"radius": "big"}], r"obstacles\[0\]"),
        ([DISC | {"centre": [4.0, 0.0]}], "within the reach"),
    ):
        with pytest.raises(ValueError, match=message):
            gym.make(make, obstacles=given)
    with pytest.raises(ValueError, match="quasi_static"):
        gym.make(make, control="tension", backend="mujoco")
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
