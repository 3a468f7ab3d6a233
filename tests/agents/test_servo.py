"""Controllers for arms that are not the nominal one: what they identify, what they send, what they reach."""

import gymnasium as gym
import numpy as np
import pytest
from typer.testing import CliRunner

from baseline_runs import success_of
from tensegrity_agents.command.program import app
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.controllers.resting import ends_of_plans
from tensegrity_agents.evaluation.tuning import tune
from tensegrity_envs.seeding import VALIDATION_SEED

TENSION, PAYLOAD = (f"tensegrity/TwoX{kind}ReachUncertain-v0" for kind in ("Tension", "Payload"))
LOADED, DYNAMIC = (f"tensegrity/DualTriangleLoadedReachUncertain{kind}-v0" for kind in ("", "MuJoCo"))


def run(env_id, name, steps, count=100):
    """Info of each step, and the memory after it."""
    envs = gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    controller = make_controller(name, env_id)
    observation, info = envs.reset(seed=VALIDATION_SEED)
    controller.begin_episodes(np.ones(count, bool), envs.unwrapped.design)
    memory, runs, told = None, np.ones(count, bool), [info]
    for step in range(steps):
        action, memory = controller.predict(observation, memory, np.full(count, step == 0))
        observation, _, terminated, truncated, info = envs.step(action)
        runs &= ~(terminated | truncated)
        told.append(info)
    return told, memory, runs


@pytest.mark.parametrize(("env_id", "closest", "share"), [(TENSION, 0.004, 0.9), (PAYLOAD, 0.03, 0.75)])
def test_stiffness_mass_and_payload_are_identified(env_id, closest, share):
    """As well as the filter says; where angles follow from a noisy tip it is too sure of itself."""
    told, memory, runs = run(env_id, "identifying_observer", 80)
    info = told[-1]
    true = np.stack([info["random_stiffness"], info["random_mass"], info["payload"]], axis=1)[runs]
    mean, covariance = memory.belief.mean[runs], memory.belief.covariance[runs]
    assert np.median(np.abs(mean[:, 0] - true[:, 0])) < closest
    spread = np.sqrt(np.einsum("nii->ni", covariance))
    assert (np.abs(mean - true) < 4 * spread + 1e-3).mean() > share
    assert (np.abs(mean[:, 2] - true[:, 2]) < 0.05).mean() > 0.9


@pytest.mark.parametrize("name", ["servo", "identifying_observer"])
def test_the_command_is_what_acts_once_the_delay_is_over(name):
    """Own command and measured tensions differ while the arm moves, and are the same at rest."""
    told, memory, runs = run(TENSION, name, 70)
    late = told[-1]["random_actuation_delay"] > 0
    assert np.median(np.abs(memory.inputs - told[-1]["tensions"])[runs].max(axis=1)) < 0.5
    told, memory, runs = run(TENSION, name, 6)
    gap = np.abs(memory.inputs - told[-1]["tensions"]).max(axis=1)
    assert np.median(gap[runs & late]) > 3.0
    assert gap[runs & ~late].max() < 1e-3


@pytest.mark.parametrize(
    ("env_id", "name", "least"),
    [
        (TENSION, "servo", 0.85),
        (TENSION, "identifying_observer", 0.97),
        (PAYLOAD, "servo", 0.8),
        (PAYLOAD, "identifying_observer", 0.92),
        (LOADED, "identifying_observer", 0.92),
        (DYNAMIC, "identifying_observer", 0.75),
    ],
)
def test_uncertain_arms_reach_where_the_observer_does_not(env_id, name, least):
    if env_id == DYNAMIC:
        pytest.importorskip("mujoco")
    success = [success_of(env_id, one) for one in ("observer", name)]
    assert success[0] < 0.35
    assert success[1] >= least


@pytest.mark.parametrize("env_id", [TENSION, PAYLOAD, LOADED])
def test_the_nominal_arm_is_not_forgotten(env_id):
    assert success_of(env_id, "identifying_observer", level=0) >= 0.95


def test_ends_of_plans():
    plans = np.zeros((3, 10, 2))
    plans[1, 4:] = 1.0  # the fifth step is the last that changes anything
    plans[2] = np.arange(10)[:, None]
    np.testing.assert_array_equal(ends_of_plans(plans, 1e-9), [0, 4, 9])


def test_tuning_finds_the_best_of_the_grid(monkeypatch):
    from tensegrity_agents.controllers.two_x import Servo

    monkeypatch.setattr(Servo, "tunable", {"gain": (0.15, 5.0)})
    tried = tune("servo", PAYLOAD, 40)
    assert [one.settings["gain"] for one in tried] == [0.15, 5.0]
    assert tried[0].success > tried[1].success
    with pytest.raises(ValueError, match="nothing to tune"):
        tune("observer", PAYLOAD, 10)


def test_an_interrupted_tuning_shows_the_best_so_far(monkeypatch):
    from tensegrity_agents.controllers.two_x import Servo
    from tensegrity_agents.evaluation import tuning

    evaluated, evaluate = [], tuning.evaluate

    def interrupted(controller, *rest, **options):
        evaluated.append(controller.gain)
        if len(evaluated) == 3:
            raise KeyboardInterrupt
        return evaluate(controller, *rest, **options)

    monkeypatch.setattr(Servo, "tunable", {"gain": (5.0, 0.15, 1.0)})
    monkeypatch.setattr(tuning, "evaluate", interrupted)
    words = ["tune", PAYLOAD.partition("/")[2], "--controller", "servo", "--episodes", "20"]
    shown = CliRunner().invoke(app, words)
    assert shown.exit_code == 130
    lines = [line for line in shown.output.splitlines() if "gain = " in line]
    assert [line.split("gain = ")[1].strip() for line in lines] == ["0.15", "5"]


def test_the_observer_of_the_dual_triangle_looks_before_it_plans():
    """The inputs are held; then the plan is that of the mean of what was seen, as the observer makes it."""
    envs = gym.make_vec(LOADED, 12, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    controller = make_controller("identifying_observer", LOADED)
    looks = controller.looks
    assert looks > 4
    seen, _ = envs.reset(seed=VALIDATION_SEED)
    memory, tips = None, []
    for step in range(looks + 1):
        observed = controller.decode(seen)
        tips.append(observed.tip)
        action, memory = controller.predict(seen, memory, np.full(12, step == 0))
        assert (np.abs(action).max() > 0.5) == (step == looks)
        seen, *_ = envs.step(action)
    mean = observed.replace(tip=np.mean(tips[-looks:], axis=0))
    expected = controller.planner.initial(mean, np.arange(12)).plan
    np.testing.assert_allclose(memory.plan.plan, expected, atol=1e-9)
