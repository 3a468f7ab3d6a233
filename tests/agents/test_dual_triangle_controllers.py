"""What the analytic controllers of the dual-triangle arm must reach, and what their parts compute."""

import gymnasium as gym
import numpy as np
import pytest

from baseline_runs import of_group, run_of, success_of
from tensegrity_agents.controllers import baselines_of, make_controller
from tensegrity_agents.controllers.dual_triangle import Observer
from tensegrity_agents.controllers.dual_triangle.identification import advance, explain
from tensegrity_agents.controllers.dual_triangle.planning import (
    RoadMap,
    choose_posture,
    postures,
    schedules,
    straight_clearance,
    validity,
)
from tensegrity_agents.controllers.dual_triangle.stiffening import Loop, hold, withstood
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_envs.mechanics.dual_triangle import ZHAO2021_CAPTION, ZHAO2021_TEXT, DualTriangle
from tensegrity_envs.seeding import VALIDATION_SEED

REACH, LOADED, PUSH = (f"tensegrity/DualTriangle{name}-v0" for name in ("Reach", "LoadedReach", "Push"))
ARM = DualTriangle(ZHAO2021_CAPTION)
CRITICAL = float(ARM.straight_critical_loads()[0])
BOUND = float(ZHAO2021_CAPTION.free_length1)
LENGTHS = (0.0, 1.5 * BOUND)
RATE = 0.05 * BOUND
# Of 1,000 validation episodes the straight joint path to every posture of the target is unstable in this one.
NO_STRAIGHT_WAY = VALIDATION_SEED + 362


def begun(env_id, n, seed=VALIDATION_SEED):
    envs = gym.make_vec(env_id, n, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    observation, info = envs.reset(seed=seed)
    return envs, observation, info, envs.unwrapped.core.schema.decode(observation)


def loaded_states(design, n, seed):
    """Stable equilibria: configurations (n', 3), loads (n', 2), free lengths (n', 6), tips (n', 2)."""
    rng = np.random.default_rng(seed)
    arm = DualTriangle(design)
    q = rng.uniform(-1, 1, (3, n)) * float(design.joint_limit)
    angle, size = rng.uniform(-np.pi, np.pi, n), 1.5 * float(arm.straight_critical_loads()[0]) * rng.random(n)
    load = np.stack([size * np.cos(angle), size * np.sin(angle)])
    lengths = np.stack(arm.free_lengths(arm.control(tuple(q), tuple(load))))
    good = arm.stability_margin(tuple(q), tuple(lengths), tuple(load)) > 0.01
    return tuple(v.T[good] for v in (q, load, lengths, np.stack(arm.tip(tuple(q)))))


# ------------------------------------------------------------------------------------------------- reading, identifying


@pytest.mark.parametrize("env_id", [REACH, LOADED, PUSH])
def test_a_reading_undoes_the_normalization(env_id):
    envs, _, info, reading = begun(env_id, 20)
    np.testing.assert_allclose(reading.inputs, info[envs.unwrapped.core.input_name], atol=1e-8)
    if env_id == LOADED:
        assert "joint_angles" not in reading
    else:
        np.testing.assert_allclose(reading.joint_angles, info["configuration"], atol=1e-6)


def test_configuration_and_load_are_found_from_tip_and_inputs():
    _, _, info, reading = begun(LOADED, 300)
    found = explain(ARM, reading.tip, np.stack(ARM.free_lengths(tuple(reading.inputs.T)), axis=1))
    assert (found.explanations == 1).all()
    np.testing.assert_allclose(found.configuration, info["configuration"], atol=2e-5)
    np.testing.assert_allclose(found.load, info["load"], atol=1e-3 * CRITICAL)


@pytest.mark.parametrize("design", [ZHAO2021_CAPTION, ZHAO2021_TEXT])
def test_there_is_one_stable_explanation(design):
    q, load, lengths, tip = loaded_states(design, 1500, 1)
    found = explain(DualTriangle(design), tip, lengths)
    assert len(q) > 500
    assert (found.explanations == 1).all()
    np.testing.assert_allclose(found.configuration, q, atol=1e-6)
    np.testing.assert_allclose(found.load, load, atol=1e-6 * CRITICAL)


def test_explanations_are_those_of_the_mechanism():
    _, _, lengths, tip = loaded_states(ZHAO2021_CAPTION, 12, 2)
    found = explain(ARM, tip, lengths)
    for i, row in enumerate(zip(tip, lengths, strict=True)):
        stable = [s for s in ARM.identify(*row[0], row[1]) if s.is_stable]
        assert len(stable) == found.explanations[i]
        np.testing.assert_allclose(stable[0].configuration, found.configuration[i], atol=1e-7)


def test_without_an_explanation_the_straight_arm_is_assumed():
    found = explain(ARM, np.array([[1.0, 1.0]]), np.full((1, 6), BOUND))
    assert found.explanations[0] == 0
    assert not found.configuration.any()


def test_the_model_advances_as_the_environment_does():
    envs, _, info, reading = begun(LOADED, 50)
    action = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    new = np.clip(reading.inputs + RATE * action, -BOUND, BOUND)
    q, stable, tip = advance(ARM, info["configuration"], reading.inputs, new, info["load"])
    observation, _, terminated, _, _ = envs.step(action.astype(np.float32))
    np.testing.assert_array_equal(stable, ~terminated)
    np.testing.assert_allclose(tip[stable], observation["achieved_goal"][stable], atol=1e-6)
    assert q.shape == (50, 3)


# ------------------------------------------------------------------------------------------------------------ planning


def test_postures_have_the_tip_at_the_target_and_validity_is_that_of_the_mechanism():
    target, load = np.array([[0.22, 0.05], [0.1, 0.02]]), np.array([[-0.5, 0.3], [1.0, 0.0]])
    table = postures(ARM, target)
    np.testing.assert_allclose(
        np.stack(ARM.tip(tuple(np.moveaxis(table, -1, 0))), -1), target[:, None] + 0 * table[..., :2]
    )
    clearance, inputs = validity(ARM, BOUND, table, load[:, None])
    for row, column in ((0, 3), (0, 50), (1, 20)):
        q, force = tuple(table[row, column]), tuple(load[row])
        expected = min(
            ARM.stability_margin(q, None, force),
            ARM.limit_margin(q),
            1 - np.abs(ARM.control(q, force)).max() / BOUND,
        )
        assert clearance[row, column] == pytest.approx(expected, abs=1e-9)
        np.testing.assert_allclose(inputs[row, column], ARM.control(q, force), atol=1e-12)


def test_a_schedule_keeps_the_rate_and_ends_at_the_goal():
    path, load = np.array([[0.2, -0.3, 0.4], [0.9, 0.1, -0.6]]), np.array([0.4, -0.2])
    plan = schedules(ARM, [path], load[None], RATE, 100)[0]
    first = np.stack(ARM.control(tuple(path[0]), tuple(load)))
    assert np.abs(np.diff(np.vstack([first, plan]), axis=0)).max() <= RATE * 1.01
    np.testing.assert_allclose(plan[-1], ARM.control(tuple(path[1]), tuple(load)), atol=1e-12)


def test_the_road_map_goes_round_where_no_straight_path_is_stable():
    _, _, info, reading = begun(LOADED, 1, NO_STRAIGHT_WAY)
    q, load = info["configuration"], info["load"]
    _, clearance = choose_posture(ARM, BOUND, q, reading.target, load)
    assert clearance[0] < 0
    way = RoadMap(ARM, BOUND, load[0], np.random.default_rng(0)).path(q[0], reading.target[0], RATE)
    assert len(way) >= 2
    np.testing.assert_allclose(ARM.tip(tuple(way[-1])), reading.target[0], atol=1e-9)
    points = np.array([q[0], *way])
    assert (straight_clearance(ARM, BOUND, points[:-1], points[1:], np.repeat(load, len(way), 0)) > 0).all()


# ------------------------------------------------------------------------------------------------------ holding stiffly


def test_stiffest_inputs_hold_the_posture_at_a_bound():
    rng = np.random.default_rng(3)
    q = tuple(rng.uniform(-0.9, 0.9, (3, 200)))
    load = tuple(0.3 * CRITICAL * rng.uniform(-1, 1, (2, 200)))
    held = hold(ARM, LENGTHS, q, load)
    fine = held.stability_margin > 0
    assert fine.mean() > 0.8
    lengths = np.stack(held.free_lengths)[:, fine]
    gradient = ARM.energy_gradient(tuple(v[fine] for v in q), tuple(lengths), tuple(v[fine] for v in load))
    assert np.abs(np.stack(gradient)).max() < 1e-12 * 500
    assert lengths.min() >= -1e-12
    assert lengths.max() <= LENGTHS[1] + 1e-12
    pairs = lengths.reshape(3, 2, -1)
    np.testing.assert_allclose(pairs.max(axis=1), LENGTHS[1], atol=1e-12)  # one spring of each segment is at its bound
    softer = hold(ARM, LENGTHS, q, load, (0.0, 0.0, 0.0), 0.0)
    assert (softer.stability_margin <= held.stability_margin + 1e-12)[fine].all()


def test_what_a_posture_withstands():
    q = tuple(np.array([[0.3, 0.0], [-0.5, 0.0], [0.6, 0.0]]))
    force = withstood(ARM, LENGTHS, q, (-1.0, 0.0), 4 * CRITICAL)
    assert force[1] == pytest.approx(1.5 * CRITICAL, rel=2e-3)  # straight: the stiffness of 1.5 times the free length
    below, above = (hold(ARM, LENGTHS, q, (-f * force, 0 * force)).stability_margin for f in (0.995, 1.005))
    assert (below > 0).all()
    assert (above <= 0).all()


def test_the_place_on_the_self_motion_curve():
    s = np.linspace(0.1, 6.1, 40)
    loop = Loop(ARM, (np.full(40, 0.26), np.linspace(-0.01, 0.01, 40)))
    q = loop.at(s)
    np.testing.assert_allclose(loop.place(q), s, atol=1e-7)
    np.testing.assert_allclose(ARM.tip(tuple(q))[0], 0.26)


# ------------------------------------------------------------------------------------------------- what must be reached

LEAST = {
    (REACH, "closed_form_sum"): 0.98,
    (REACH, "closed_form_max"): 0.98,
    (REACH, "closed_form_squares"): 0.98,
    (REACH, "pseudo_inverse"): 0.98,
    (REACH, "observer"): 0.98,
    (REACH, "oracle"): 0.98,
    (LOADED, "pseudo_inverse"): 0.65,
    (LOADED, "observer"): 0.98,
    (LOADED, "oracle"): 1.0,
}


@pytest.mark.parametrize(("env_id", "name"), LEAST)
def test_success(env_id, name):
    assert success_of(env_id, name) >= LEAST[env_id, name]


@of_group(LOADED)
def test_nominal_controllers_fail_under_load():
    assert success_of(LOADED, "closed_form_squares") < 0.2


def test_the_oracle_goes_where_the_observer_buckles():
    runs = {
        name: evaluate(make_controller(name, LOADED), LOADED, 1, NO_STRAIGHT_WAY, name)
        for name in ("observer", "oracle")
    }
    assert runs["observer"].reasons == ["buckled"]
    assert runs["oracle"].columns["success"].all()


@of_group(PUSH)
def test_the_push_is_held_up_to_what_the_best_posture_withstands():
    runs = {name: run_of(PUSH, name) for name in baselines_of(PUSH)}
    scores = {name: run.columns["score"] for name, run in runs.items()}
    assert scores["random"].mean() < scores["closed_form"].mean() < scores["pseudo_inverse"].mean()
    assert scores["pseudo_inverse"].mean() < scores["observer"].mean()
    for name in ("observer", "oracle"):
        assert runs[name].columns["success"].all()
        assert scores[name].mean() > 1.68
    # At the target itself, without its tolerance: all places of the curve, the best inputs.
    _, _, _, reading = begun(PUSH, 40)
    places = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    x, y = np.repeat(reading.target, 360, axis=0).T
    strength = withstood(ARM, LENGTHS, Loop(ARM, (x, y)).at(np.tile(places, 40)), (-1.0, 0.0), 4 * CRITICAL)
    step = 0.3 / 150 * 500 * 0.05 / CRITICAL
    assert (scores["observer"] >= strength.reshape(40, 360).max(axis=1) / CRITICAL - step).all()


@pytest.mark.parametrize(("env_id", "name"), [(PUSH, "observer"), (LOADED, "pseudo_inverse"), (LOADED, "oracle")])
def test_batches_do_not_matter(env_id, name):
    whole, parts = (
        evaluate(make_controller(name, env_id), env_id, 9, VALIDATION_SEED, name, batch=b).columns for b in (9, 4)
    )
    np.testing.assert_array_equal(whole["success"], parts["success"])
    np.testing.assert_array_equal(whole["steps"], parts["steps"])
    if env_id == PUSH:
        np.testing.assert_allclose(whole["score"], parts["score"])


@pytest.mark.parametrize("env_id", [REACH, LOADED, PUSH])
def test_only_oracles_are_told(env_id):
    for name in baselines_of(env_id):
        controller = make_controller(name, env_id)
        assert controller.knows
        told = getattr(controller, "wants_privileged", False)
        assert told == (name == "oracle")
        if told:
            with pytest.raises(ValueError, match="privileged"):
                controller.begin_episodes(np.ones(1, bool), ZHAO2021_CAPTION, None)


@pytest.mark.parametrize(
    ("env_id", "name"), [(e, n) for e in (REACH, LOADED, PUSH) for n in ("observer", "pseudo_inverse")]
)
def test_the_same_observation_gives_the_same_action(env_id, name):
    """Nothing but the observation is used: a second controller, of which nobody knows the episodes, does the same."""
    envs, observation, _, _ = begun(env_id, 6)
    first, second = make_controller(name, env_id), make_controller(name, env_id)
    first.begin_episodes(np.ones(6, bool), ZHAO2021_CAPTION, None)
    memories, start = [None, None], np.ones(6, bool)
    for _ in range(5):
        actions = []
        for k, controller in enumerate((first, second)):
            action, memories[k] = controller.predict(observation, memories[k], start)
            actions.append(action)
        np.testing.assert_array_equal(*actions)
        assert np.abs(actions[0]).max() <= 1.0
        observation, _, terminated, truncated, _ = envs.step(actions[0])
        start = terminated | truncated


def test_the_observer_reaches_with_another_design():
    options = {"design": ZHAO2021_TEXT}
    core = gym.make(LOADED, **options).unwrapped.core
    run = evaluate(Observer(core), LOADED, 60, VALIDATION_SEED, "observer", env_options=options)
    assert run.columns["success"].mean() >= 0.95
