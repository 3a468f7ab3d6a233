"""Arms of one's own, trained, evaluated and compared from YAML and the command line: options count everywhere."""

import json

import gymnasium as gym
import numpy as np
import pytest

from tensegrity_agents import env_options
from tensegrity_agents.config import ConfigError, Experiment, load_experiment
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.env_options import canonical, check_options, explain, parse_design, parse_level, results_name
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.evaluation.transfer import pair_of, transfer
from tensegrity_agents.experiment import candidates, evaluate_all, train_agents
from tensegrity_agents.sb3.policy_file import load_policy
from tensegrity_agents.sb3.training import TrainingError
from tensegrity_envs.mechanics import MURALIDHARAN2022
from tensegrity_envs.seeding import TEST_SEED, VALIDATION_SEED
from tensegrity_envs.vector_env import ManipulatorVectorEnv

REACH = "tensegrity/TwoXReach-v0"
LOADED = "tensegrity/DualTriangleLoadedReach-v0"
TRAIN = {"total_timesteps": 64, "net_arch": [4], "ppo": {"num_envs": 4, "n_steps": 8}}
OWN = {"design": {"b": 0.06}, "tolerance": 0.02, "randomization": {"stiffness": [0.9, 1.1]}}


def silent(*_):
    pass


def test_spellings_of_a_design(tmp_path):
    (tmp_path / "arm.yaml").write_text("base: muralidharan2022\nb: 6e-2\n")
    spellings = [
        "muralidharan2022,b=0.06",
        "base=muralidharan2022,b=0.06",
        "b=0.06, base = muralidharan2022",
        '{"base": "muralidharan2022", "b": 0.06}',
        "{base: muralidharan2022, b: 0.06}",
        str(tmp_path / "arm.yaml"),
        f"{tmp_path / 'arm.yaml'},b=0.06",
    ]
    options = [{"design": parse_design(text)} for text in spellings]
    assert all(canonical(REACH, each) == canonical(REACH, options[0]) for each in options)
    assert len({results_name(REACH, each) for each in options}) == 1
    assert canonical(REACH, options[0])["design"]["b"] == 0.06
    assert canonical(REACH, options[0])["design"]["l"] == MURALIDHARAN2022.l
    assert parse_design("b=0.06,l=0.2") == {"b": 0.06, "l": 0.2}


@pytest.mark.parametrize("text", ["base=", "=5", "b=", ",,,", "a,b", "b=1,b=2", "muralidharan2022,base=furet2018"])
def test_a_design_that_cannot_be_read_says_what_works(text):
    with pytest.raises(ConfigError, match=f"{text}: .*(--design takes a published design|is given twice)"):
        parse_design(text)


def test_levels_of_which_each_episode_has_one_keep_their_ranges():
    """What was given for all of them is told beside their numbers, so that each folder is of one environment."""
    arm, noise = "tensegrity/TwoXPayloadReachUncertain-v0", {"tip_noise": 0.001}
    of_both = check_options(arm, {"level": 2}).randomization.stiffness
    options = [
        {"level": [0, 2]},
        {"level": [0, 2], "randomization": noise},
        {"level": [0, 2], "randomization": noise | {"stiffness": of_both}},
        {"level": [0, 2], "randomization": {"stiffness": of_both}},
        {"level": [0, 1, 2, 3]},
    ]
    for given in options:
        assert check_options(arm, canonical(arm, given)).randomization == check_options(arm, given).randomization
    assert len({results_name(arm, given) for given in options}) == len(options)
    assert results_name(arm, {"level": "drawn"}) == results_name(arm, options[-1])
    assert results_name(arm, {"level": [0, 2], "randomization": {}}) == results_name(arm, options[0])


@pytest.mark.parametrize(("text", "level"), [("2", 2), ("2,0", [0, 2]), ("[0, 2]", [0, 2]), ("drawn", "drawn")])
def test_levels_as_text(text, level):
    assert parse_level(text, "--level") == level
    assert Experiment(env=LOADED, train={"total_timesteps": 1}, level=text).level == level


@pytest.mark.parametrize("wrong", ["4", "-1", "x", "", "(0,2", True])
def test_what_is_no_level_says_what_would_be(wrong):
    with pytest.raises(ValueError, match="must be from 0 to 3, several such as"):
        Experiment(env=LOADED, train={"total_timesteps": 1}, level=wrong)


def test_options_that_change_nothing_leave_the_results_folder_as_it_is():
    assert results_name(REACH, {}) == "TwoXReach-v0"
    tolerance = gym.make(REACH).unwrapped.core.task.tolerance
    assert results_name(REACH, {"tolerance": tolerance, "randomization": {}, "design": {}}) == "TwoXReach-v0"
    assert results_name(LOADED, {"load_range": [0, 1.5]}) == "DualTriangleLoadedReach-v0"
    names = [
        results_name(LOADED, options)
        for options in (
            {},
            {"load_range": [0, 1]},
            {"tolerance": 0.02},
            {"design": "zhao2021_text"},
            {"design": {"base": "zhao2021_text", "max_joint_angle": 1.2}},
            {"randomization": {"stiffness": [0.9, 1.1]}},
            {"randomization": {"stiffness": [0.9, 1.2]}},
        )
    ]
    assert len(set(names)) >= len(names) - 1  # one of the published designs is the environment's


def test_fields_that_are_left_out_are_explained():
    (line,) = explain(REACH, {"design": {"b": 0.06}})
    assert line.startswith("design: b = 0.06; all other fields are those of muralidharan2022")
    (line,) = explain(REACH, {"design": {"b": 0.06, "base": "furet2018"}})
    assert line == "design: b = 0.06; all other fields are those of furet2018"


def test_a_config_with_an_arm_of_ones_own(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(
        "env: DualTriangleLoadedReach-v0\nload_range: [0, 1]\ntolerance: 1e-2\ndesign: zhao2021_text\n"
        "randomization: {stiffness: [0.9, 1.1]}\ntrain: {total_timesteps: 5, env_options: {reward_type: sparse}}\n"
    )
    experiment = load_experiment(path)
    assert experiment.options == {
        "design": "zhao2021_text",
        "randomization": {"stiffness": [0.9, 1.1]},
        "tolerance": 0.01,
        "load_range": [0.0, 1.0],
    }
    assert experiment.training_options == experiment.options | {"reward_type": "sparse"}


def test_the_arm_of_the_training_is_that_of_the_evaluation_unless_the_experiment_says_otherwise():
    train = TRAIN | {"env_options": {"tolerance": 0.05, "reward_type": "sparse"}}
    assert Experiment(env=REACH, train=train).options == {"tolerance": 0.05}
    easier = Experiment(env=REACH, train=train, tolerance=0.01)
    assert (easier.options["tolerance"], easier.training_options["tolerance"]) == (0.01, 0.05)
    train = TRAIN | {"env_options": {"randomization": {"stiffness": [0.9, 1.1]}}}
    nominal = Experiment(env=REACH, train=train, randomization={})
    assert nominal.options == {"randomization": {}}
    assert nominal.training_options["randomization"]


def test_comparisons_train_and_evaluate_with_the_options(tmp_path, monkeypatch):
    """Every vector environment that is made, in training and evaluation, is of this arm; and agents are not mixed."""
    made = []
    init = ManipulatorVectorEnv.__init__

    def recorded(self, *args, **kwargs):
        init(self, *args, **kwargs)
        made.append(self.core)

    monkeypatch.setattr(ManipulatorVectorEnv, "__init__", recorded)
    own = Experiment(env=REACH, train=TRAIN, episodes=20, controllers=["oracle", "random"], **OWN)
    found = evaluate_all(own, tmp_path / own.results_name, silent)
    assert len(made) >= 4
    for core in made:
        assert core.design.b == 0.06
        assert core.task.tolerance == 0.02
        assert core.randomization.names == ["stiffness"]
    assert found.descriptions[0]["options"] == canonical(REACH, own.options)
    oracle = evaluate(make_controller("oracle", REACH, OWN), REACH, 20, TEST_SEED, "oracle", env_options=OWN)
    np.testing.assert_array_equal(oracle.columns["final_error_m"], found.runs[1].columns["final_error_m"])
    usual = Experiment(env=REACH, train=TRAIN)
    with pytest.raises(TrainingError, match="options"):
        train_agents(usual, tmp_path / own.results_name, silent)
    assert usual.results_name == "TwoXReach-v0"
    again = train_agents(own, tmp_path / own.results_name, silent)
    assert found.descriptions[0].items() <= again[0].description.items()  # loaded, not trained again


def test_policies_know_their_arm(tmp_path):
    own = Experiment(env=REACH, train=TRAIN, **OWN)
    train_agents(own, tmp_path, silent)
    home = str(tmp_path / "agent-0")
    options = json.loads((tmp_path / "agent-0" / "policy.json").read_text())["options"]
    assert options == canonical(REACH, OWN)
    assert load_policy(home).description["options"] == options
    assert load_policy(home + "/policy.json", REACH, options).description["options"] == options


def test_transfer_uses_the_options(tmp_path, monkeypatch):
    pair = pair_of("tensegrity/TwoXTensionReach-v0")
    options = {"design": {"b": 0.06}, "tolerance": 0.02}
    own = Experiment(env=pair[0], train=TRAIN, **options)
    train_agents(own, tmp_path / own.results_name, silent)
    train_agents(Experiment(env=pair[0], train=TRAIN), tmp_path / "TwoXTensionReach-v0", silent)
    made = []
    init = ManipulatorVectorEnv.__init__

    def recorded(self, *args, **kwargs):
        init(self, *args, **kwargs)
        made.append(self.core.design.b)

    monkeypatch.setattr(ManipulatorVectorEnv, "__init__", recorded)
    found = [c for c in candidates(pair, tmp_path, options) if c.name in ("agent", "closed_form_ik")]
    assert [c.controllers[0].description["options"]["tolerance"] for c in found if c.name == "agent"] == [0.02]
    results = transfer(pair, found, 3, options=options)
    assert set(made) == {0.06}
    assert all(set(each.runs) == set(pair) for each in results)
    (usual,) = [c for c in candidates(pair, tmp_path) if c.name == "agent"]
    assert usual.controllers[0].description["options"] == {}


def test_names_of_the_options_are_arguments_of_environments():
    assert set(env_options.NAMES) <= set(Experiment.model_fields)
    run = evaluate(make_controller("closed_form_ik", REACH), REACH, 3, VALIDATION_SEED, "ik")
    assert run.columns["success"].shape == (3,)
