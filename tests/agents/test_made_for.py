"""A controller acts where it was made for: who is told ranges says so, and evaluation refuses it where they differ."""

import inspect

import gymnasium as gym
import numpy as np
import pytest

import law_rows
import tensegrity_envs
from tensegrity_agents.controllers import baselines_of, make_controller
from tensegrity_agents.evaluation.player import Player
from tensegrity_agents.evaluation.rollout import ControllerError, announce, evaluate
from tensegrity_envs.seeding import VALIDATION_SEED

TENSION = "tensegrity/TwoXTensionReach-v0"
FAST = "tensegrity/TwoXFastReachMuJoCo-v0"
COUNT = 2
CASES = law_rows.controllers(tensegrity_envs.ENV_IDS)


def looked_at(core, monkeypatch):
    """What modules of controllers read of what differs from episode to episode, as it comes."""
    seen = []

    class Watched(type(core)):
        def __getattribute__(self, name):
            if name in ("randomization", "payload_range"):
                caller = inspect.currentframe().f_back.f_globals["__name__"]
                if caller.startswith("tensegrity_agents.controllers") and not caller.endswith("made_for"):
                    seen.append((caller, name))
            return super().__getattribute__(name)

    monkeypatch.setattr(core, "__class__", Watched)
    return seen


@pytest.mark.parametrize(("env_id", "name"), CASES)
def test_who_looks_at_the_ranges_says_so(env_id, name, monkeypatch):
    if gym.spec(env_id).kwargs.get("backend") == "mujoco":
        pytest.importorskip("mujoco")
    envs = gym.make_vec(env_id, COUNT, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    shell = envs.unwrapped
    observation, _ = envs.reset(seed=3)
    core = gym.make(env_id).unwrapped.core
    seen = looked_at(core, monkeypatch)
    controller, state = baselines_of(env_id)[name](core), None
    announce(controller, shell.design, shell.episode, COUNT)
    for step in range(2):
        actions, state = controller.predict(observation, state, np.full(COUNT, step == 0))
        observation = envs.step(actions)[0]
    assert controller.is_told_ranges == bool(seen)
    envs.close()


@pytest.mark.parametrize(
    ("name", "env_id"),
    [("identifying_observer", TENSION), ("lqg", FAST), ("mpc", "tensegrity/TwoXTensionReachUncertain-v0")],
)
def test_controllers_made_for_another_level_are_refused(name, env_id):
    if "MuJoCo" in env_id:
        pytest.importorskip("mujoco")
    controller = make_controller(name, env_id, {"level": 2})
    with pytest.raises(ControllerError) as told:
        evaluate(controller, env_id, 2, VALIDATION_SEED, name, env_options={"level": 1})
    text = str(told.value)
    assert "level 2; here: level 1" in text
    assert f"make_controller('{name}', '{env_id}', {{'level': 1}})" in text
    assert "made_elsewhere" in text
    env = gym.make(env_id, level=1)
    with pytest.raises(ValueError, match="level 2; here: level 1"):
        Player(env, controller)


def test_that_may_be_asked_for_and_is_no_matter_where_nothing_was_told():
    given = {"env_options": {"level": 1}, "first_seed": VALIDATION_SEED}
    observer = make_controller("identifying_observer", TENSION, {"level": 2})
    assert len(evaluate(observer, TENSION, 2, name="observer", made_elsewhere=True, **given).seeds) == 2
    closed = [make_controller("closed_form_ik", TENSION, {"level": level}) for level in (2, 1)]
    runs = [evaluate(controller, TENSION, 3, name="closed form", **given) for controller in closed]
    for key in runs[0].columns:
        np.testing.assert_array_equal(*(run.columns[key] for run in runs))


@pytest.mark.parametrize(
    ("made", "met", "names"),
    [
        ({"level": [0, 2]}, {"level": 2}, ["levels [0, 2]", "here: level 2"]),
        ({"randomization": {"stiffness": (0.9, 1.1)}}, {}, ["'stiffness': (0.9, 1.1)", "here: level 0"]),
        ({"payload_range": [0.0, 0.4]}, {"payload_range": [0.0, 0.3]}, ["0 to 0.4 kg", "0 to 0.3 kg"]),
        ({"observe": "tip_and_inputs"}, {}, ["observations there: tip", "joint_angles"]),
        ({"design": {"k1": 150.0}}, {}, ["the design there", "k1=150.0"]),
        ({"control": "joint"}, {}, ["rad in a step"]),
    ],
)
def test_other_environments_are_named(made, met, names):
    controller = make_controller("identifying_observer", TENSION, made)
    with pytest.raises(ControllerError) as told:
        evaluate(controller, TENSION, 2, VALIDATION_SEED, "observer", env_options=met)
    assert all(name in str(told.value) for name in names)


def test_other_dynamics_are_named():
    pytest.importorskip("mujoco")
    lqg = make_controller("lqg", FAST, {"dynamics": {"joint_damping": 0.03}})
    with pytest.raises(ControllerError, match=r"the dynamics there: .*joint_damping=0\.03"):
        evaluate(lqg, FAST, 2, VALIDATION_SEED, "lqg")
