"""Planners and baselines among obstacles, checked by Shapely and by a dense roadmap."""

from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from baseline_runs import run_of, success_of
from obstacle_ids import IDS
from tensegrity_agents.config import ConfigError, Experiment
from tensegrity_agents.controllers import baselines_of, make_controller, teachers_of
from tensegrity_agents.controllers.obstacles.clearing import Clearing
from tensegrity_agents.controllers.obstacles.planning import PathPlanner
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.experiment import evaluate_named
from tensegrity_envs.geometry.clearance import bars_of
from tensegrity_envs.seeding import VALIDATION_SEED

every_id = pytest.mark.parametrize("env_id", IDS)
SPACING = 1e-3  # [rad] of the looks at a path
LOOKS = 0.01  # [rad] of the looks along an edge of a roadmap


def looks_along(path):
    """Places (coordinates, k) along a path of waypoints (joints,)."""
    legs = []
    for a, b in pairwise(path):
        count = int(np.ceil(np.abs(b - a).max() / SPACING)) + 1
        legs.append(a[:, None] + np.linspace(0, 1, count) * (b - a)[:, None])
    return np.concatenate(legs, axis=1)


def least_by_shapely(core, place, discs):
    """The least distance of the bars at places (coordinates, k) from discs (x, y, radius), less their radii."""
    bars = np.array(list(bars_of(core.nominal, *core.space.posture(tuple(place))).values()))  # (bars, ends, axes, k)
    lines = shapely.linestrings(bars.transpose(0, 3, 1, 2).reshape(-1, 2, 2))
    return min((shapely.distance(lines, shapely.Point(x, y)) - r).min() for x, y, r in discs)


def margins(core, q):
    """The smaller margin at places (coordinates, k), by plain NumPy."""
    if core.space.kept:
        return np.min(core.nominal.flatness(core.space.lengths(q)), axis=0)
    if hasattr(core.nominal, "posture"):
        return np.minimum(*core.nominal.posture(tuple(q))[1:])
    inputs = core.nominal.control(tuple(q))
    high = float(core.simulation.bounds(core.nominal)[1])
    room = np.min([high - np.abs(delta) for delta in inputs], axis=0)
    stability = core.nominal.stability_margin(tuple(q), core.nominal.free_lengths(inputs))
    return np.minimum(stability, room / high)


def planned(env_id, count, monkeypatch):
    """Start, path and discs of the first validation episodes, as the planner of the id finds them."""
    found = []
    plan = PathPlanner.path

    def watched(self, model, start, ends, discs):
        path = plan(self, model, start, ends, discs)
        whole = [np.concatenate([q, start[len(q) :]]) for q in path]  # with what stays the same along it
        found.append(([start, *whole], discs))
        return path

    monkeypatch.setattr(PathPlanner, "path", watched)
    core = gym.make(env_id).unwrapped.core
    envs = gym.make_vec(env_id, count, vectorization_mode="vector_entry_point")
    observation, _ = envs.reset(seed=VALIDATION_SEED)
    controller = make_controller("planner", env_id)
    controller.begin_episodes(np.ones(count, bool), envs.unwrapped.design, None)
    controller.predict(observation)
    return core, found, observation["desired_goal"]


def check_paths(env_id, count, monkeypatch):
    core, found, targets = planned(env_id, count, monkeypatch)
    assert len(found) == count
    for (path, discs), target in zip(found, targets):
        assert len(path) > 1
        posture = [part for part in core.space.posture(tuple(path[-1])) if part is not None]
        assert np.hypot(*(np.ravel(core.nominal.tip(*posture)) - target)) <= core.task.tolerance / 2
        q = looks_along(path)
        assert least_by_shapely(core, q, discs.reshape(-1, 3)) > 0
        assert margins(core, q).min() > 0
        assert np.abs(q[: core.space.size]).max() <= core.space.limit


@every_id
def test_shapely_finds_no_collision_along_planned_paths(env_id, monkeypatch):
    check_paths(env_id, 25, monkeypatch)


@pytest.mark.full
@every_id
def test_shapely_finds_no_collision_along_a_thousand_planned_paths(env_id, monkeypatch):
    check_paths(env_id, 1000 // len(IDS), monkeypatch)


def roadmap_joins(is_free, starts, limit, nodes, rng):
    """Which pairs of starts (2, k, joints) a dense roadmap joins; looks along its edges are as the planner's."""
    count = starts.shape[1]
    q = rng.uniform(-limit, limit, (3 * nodes, starts.shape[2]))
    points = np.concatenate([*starts, q[is_free(q.T)][:nodes]])
    near = np.asarray(cKDTree(points).query(points, k=16)[1])
    pairs = np.unique(np.sort(np.stack([np.repeat(np.arange(len(points)), 15), near[:, 1:].ravel()]), axis=0), axis=1)
    free = np.ones(pairs.shape[1], bool)
    looks = int(np.ceil(np.abs(points[pairs[0]] - points[pairs[1]]).max() / LOOKS)) + 1
    for share in np.random.default_rng(0).permutation(np.linspace(0, 1, looks)):
        left = np.flatnonzero(free)
        a, b = points[pairs[:, left]]
        free[left] = is_free((a + share * (b - a)).T)
    one, other = pairs[:, free]
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(len(points),) * 2)
    label = connected_components(graph, directed=False)[1]
    return label[:count] == label[count : 2 * count]


def check_against_roadmap(env_id, cases, nodes):
    """Among discs that nobody has certified: the planner joins all pairs that a roadmap joins."""
    core, rng, joined, missed = gym.make(env_id).unwrapped.core, np.random.default_rng(4), 0, 0
    planner, limit = PathPlanner(core), 0.95 * core.space.limit
    same = np.ones(core.space.kept)
    for _ in range(cases):
        angle, far = rng.uniform(0, 2 * np.pi, 4), core.reach * rng.uniform(0.35, 0.9, 4)
        discs = np.stack([far * np.cos(angle), far * np.sin(angle), np.full(4, 0.08 * core.reach)])[:, :3].T.ravel()

        def is_free(q, discs=discs):
            place = np.concatenate([q, np.repeat(same[:, None], q.shape[1], axis=1)])
            return planner.is_free(core.nominal, place, discs[:, None], planner.kept)

        q = rng.uniform(-limit, limit, (4000, core.space.size))
        pairs = q[is_free(q.T)][:8].reshape(2, 4, -1)
        for start, end, is_joined in zip(*pairs, roadmap_joins(is_free, pairs, limit, nodes, rng)):
            found = planner.path(core.nominal, np.append(start, same), np.append(end, same)[None], discs)
            joined += is_joined
            missed += is_joined and not found
            if found:
                assert is_free(looks_along([start, *found])).all()
    print(f"{env_id}: of {8 * cases // 2} pairs the roadmap joins {joined}, of which the planner misses {missed}")
    assert joined > cases
    assert missed == 0


@every_id
def test_the_planner_finds_what_a_roadmap_finds(env_id):
    check_against_roadmap(env_id, 2, 1500)


@pytest.mark.full
@every_id
def test_the_planner_finds_what_a_dense_roadmap_finds(env_id):
    check_against_roadmap(env_id, 25, 8000)


@every_id
def test_going_straight_collides_and_the_planner_arrives(env_id):
    straight = "straight_path" if "DualTriangle" in env_id else "closed_form_ik"
    share = {name: success_of(env_id, name) for name in (straight, "planner")}
    assert share["planner"] >= 0.95
    assert share[straight] < 0.6


@every_id
def test_the_pseudo_inverse_seldom_touches(env_id):
    # Inputs do not move joints along straight lines.
    assert run_of(env_id, "pseudo_inverse").reasons.count("collision") <= 2


@pytest.mark.parametrize("env_id", [env_id for env_id in IDS if "FourBar" not in env_id])
def test_the_gradient_of_the_clearance_points_away(env_id):
    core = gym.make(env_id).unwrapped.core
    sampled = core.sample(np.arange(50), np.zeros(50, int))
    discs = np.concatenate([np.stack([*one.centre, one.radius]) for one in sampled.episode.obstacles])
    clearing, q = Clearing(core), np.stack(sampled.configuration)
    slope = clearing.gradient(q, discs)
    size = np.linalg.norm(slope, axis=0)  # zero where a bar that cannot move is nearest
    assert np.mean(size > 0) > 0.5
    ahead = clearing(q + 1e-4 * slope / np.maximum(size, 1e-12), discs)
    np.testing.assert_allclose(ahead - clearing(q, discs), 1e-4 * size, rtol=0.05, atol=1e-9)


def test_an_environment_without_obstacles_has_no_clearing():
    with pytest.raises(TypeError, match="NXReach: has no obstacles"):
        Clearing(gym.make("tensegrity/ThreeXReach-v0").unwrapped.core)


@pytest.mark.parametrize(
    ("env_id", "arm"), [(name, name.replace("Reach", "ObstacleReach")) for name in ("TwoXReach", "PlanarFourBarReach")]
)
def test_an_environment_that_is_given_another_arm_has_its_controllers(env_id, arm):
    env_id, own, given = f"tensegrity/{env_id}-v0", f"tests/{arm}-v0", {"arm": arm}
    assert list(baselines_of(env_id, given)) == list(baselines_of(own))
    assert list(teachers_of(env_id, given)) == list(teachers_of(own))
    assert "planner" not in baselines_of(env_id)
    runs = [
        evaluate(make_controller("planner", which, options), which, 3, VALIDATION_SEED, "planner", env_options=options)
        for which, options in ((env_id, given), (own, None))
    ]
    for key in runs[0].columns:
        np.testing.assert_array_equal(*(run.columns[key] for run in runs))
    first = evaluate_named(env_id, [], [], given, 2, "validation", lambda *_: None)
    assert [run.controller for run in first] == [next(iter(baselines_of(own)))]
    experiment = Experiment(env=env_id, train={"total_timesteps": 1}, env_options=given)
    assert experiment.compared == list(baselines_of(own))
    with pytest.raises(ConfigError, match="no controller 'oracle'"):
        experiment.changed(controllers=["oracle"])


def test_another_backend_has_the_controllers_of_that():
    env_id = "tensegrity/TwoXTensionReach-v0"
    dynamic = list(baselines_of("tensegrity/TwoXTensionReachMuJoCo-v0"))
    assert list(baselines_of(env_id, {"backend": "mujoco"})) == dynamic
    assert list(baselines_of(env_id, {"backend": "quasi_static"})) == list(baselines_of(env_id))
