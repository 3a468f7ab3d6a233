"""The campaign: rows are kept, measured once, and again as soon as their config changes."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from tensegrity_agents.campaign import FLAGS, Task, keep_median, median_record, run_campaign, tasks_of
from tensegrity_agents.command import campaign as command
from tensegrity_agents.command.program import app
from tensegrity_agents.config import Experiment, load_experiment
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.records import Record, packed, packed_times, read_record, read_records, unpacked
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.experiment import train_agents
from tensegrity_agents.pretrained import FOLDER
from tensegrity_agents.sb3.policy_file import load_policy
from tensegrity_envs import ENV_IDS
from tensegrity_envs.seeding import TEST_SEED

ROOT = Path(__file__).parents[2]
SMALL = {
    "env": "TwoXReach-v0",
    "seeds": [0, 1, 2],
    "episodes": 13,
    "controllers": ["closed_form_ik"],
    "train": {"total_timesteps": 64, "net_arch": [4], "ppo": {"num_envs": 4, "n_steps": 4, "batch_size": 8}},
}

WHOLE = Record(
    "tensegrity/TwoXReach-v0",
    "agent",
    "agent",
    20,
    {"": packed(np.ones(20, bool)), "2": packed(np.arange(20) < 7)},
    "0123456789ab",
    "what it observes",
    12.5,
    seed=0,
    frames=64,
    cpu_seconds=1.5,
    wall_seconds=2.0,
    settling={"": packed_times(np.linspace(0.1, 2.0, 20))},
)


def silent(what, done, total, remark):
    pass


def measured(experiment, folder, **more):
    found = run_campaign(tasks_of(experiment), folder / "results", folder / "records", silent, **more)
    return {task.name: row for task, row in found}


def test_flags_are_kept_to_the_bit():
    flags = np.random.default_rng(0).random(1003) < 0.7
    assert len(packed(flags)) == 252
    np.testing.assert_array_equal(unpacked(packed(flags), 1003), flags)
    assert packed(np.array([True, False, False, False, False, False, False, True])) == "81"
    with pytest.raises(ValueError, match="8 bits for 9 episodes"):
        unpacked("ff", 9)


def test_a_campaign_keeps_what_was_measured_and_does_it_once(tmp_path, monkeypatch):
    experiment = Experiment(**SMALL)
    rows = measured(experiment, tmp_path)
    assert list(rows) == ["agent-0", "agent-1", "agent-2", "closed_form_ik"]
    run = evaluate(make_controller("closed_form_ik", experiment.env), experiment.env, 13, TEST_SEED, "closed_form_ik")
    np.testing.assert_array_equal(rows["closed_form_ik"].flags(), run.columns["success"] > 0)
    assert rows["closed_form_ik"].seed is None
    assert rows["agent-1"].frames == 64
    assert rows["agent-1"].cpu_seconds > 0
    assert read_records(tmp_path / "records")["tensegrity/TwoXReach-v0"] == list(rows.values())
    monkeypatch.setattr("tensegrity_agents.campaign.measure", lambda *_: "anew")
    assert measured(experiment, tmp_path) == rows
    other = Experiment(**{**SMALL, "train": {**SMALL["train"], "net_arch": [5]}})
    assert {name for name, row in measured(other, tmp_path).items() if row == "anew"} == {
        "agent-0",
        "agent-1",
        "agent-2",
    }
    monkeypatch.undo()
    assert measured(other, tmp_path)["agent-0"].config != rows["agent-0"].config


def test_time_that_was_not_counted_is_not_made_up(tmp_path):
    experiment = Experiment(**SMALL | {"seeds": [0], "controllers": []})
    home = Task(experiment, 0).home(tmp_path / "results")
    train_agents(experiment, home.parent, silent)
    assert measured(experiment, tmp_path)["agent-0"].cpu_seconds is None


def test_two_processes_find_the_same(tmp_path):
    experiment = Experiment(**SMALL | {"seeds": [0]})
    one, two = measured(experiment, tmp_path / "one"), measured(experiment, tmp_path / "two", jobs=2)
    assert {name: row.successes for name, row in one.items()} == {name: row.successes for name, row in two.items()}


def test_a_failure_costs_the_other_rows_nothing(tmp_path):
    experiment = Experiment(**SMALL | {"seeds": [0], "controllers": ["no.such:Module", "closed_form_ik"]})
    rows = measured(experiment, tmp_path)
    assert [isinstance(row, Exception) for row in rows.values()] == [False, True, False]
    assert not (tmp_path / "records" / "TwoXReach-v0" / "no.such-Module.json").exists()


def test_what_stops_a_row_leaves_those_before_it(tmp_path, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    experiment = Experiment(**SMALL | {"seeds": [0]})
    monkeypatch.setattr("tensegrity_agents.campaign.make_controller", stopped)
    with pytest.raises(KeyboardInterrupt):
        measured(experiment, tmp_path)
    assert Task(experiment, 0).kept(tmp_path / "records") is not None
    monkeypatch.undo()
    assert set(measured(experiment, tmp_path)) == {"agent-0", "closed_form_ik"}


def test_the_median_seed_is_kept_once_all_are_there(tmp_path, monkeypatch):
    experiment = Experiment(**SMALL)
    folders = [tmp_path / name for name in ("results", "records", "policies")]
    measured(experiment.changed(seeds=[0]), tmp_path)
    assert keep_median(experiment, *folders) is None
    rows = measured(experiment, tmp_path)
    chosen = median_record([rows[f"agent-{seed}"] for seed in experiment.seeds])
    home = keep_median(experiment, *folders)
    kept, whole = load_policy(home), load_policy(Task(experiment, chosen.seed).home(folders[0]))
    assert kept.description["seed"] == chosen.seed
    for key, value in whole.policy.state_dict().items():
        np.testing.assert_array_equal(kept.policy.state_dict()[key], value.half().float())
    np.testing.assert_array_equal(kept.normalization.variance, whole.normalization.variance)
    assert (home / FLAGS).read_text().strip() == "".join("01"[flag] for flag in chosen.flags().astype(int))
    monkeypatch.delattr("tensegrity_agents.campaign.evaluate")
    assert keep_median(experiment, *folders) == home  # what is there is not checked again


def test_the_median_is_the_lower_middle():
    def row(seed, successes):
        return Record("e", "agent", "agent", 8, {"": packed(np.arange(8) < successes)}, "", seed=seed)

    assert median_record([row(0, 8), row(1, 2), row(2, 5)]).seed == 2
    assert median_record([row(0, 8), row(1, 2), row(2, 5), row(3, 6)]).seed == 2


def test_uncertain_ids_are_measured_at_every_level(tmp_path):
    experiment = Experiment(
        **SMALL | {"env": "TwoXTensionReachUncertain-v0", "seeds": [0], "controllers": ["closed_form_ik"]}
    )
    row = Task(experiment, None, "closed_form_ik")
    ((_, found),) = run_campaign([row], tmp_path, tmp_path / "records", silent)
    assert list(found.successes) == ["", "0", "1", "2", "3"]
    assert found.successes[""] == found.successes["2"]
    nominal = evaluate(
        make_controller("closed_form_ik", experiment.env, {"level": 0}),
        experiment.env,
        13,
        TEST_SEED,
        "",
        "baseline",
        {"level": 0},
    )
    np.testing.assert_array_equal(found.flags("0"), nominal.columns["success"] > 0)


def test_levels_are_kept_as_they_come(tmp_path, monkeypatch):
    """A row with some of its levels goes on with the others, and is what it would have been at once."""
    experiment = Experiment(
        **SMALL | {"env": "TwoXTensionReachUncertain-v0", "seeds": [0], "controllers": ["closed_form_ik"]}
    )
    measured, asked = evaluate, []

    def noted(controller, env_id, episodes, *more):
        asked.append(more[3])
        if len(asked) == 4:
            raise KeyboardInterrupt
        return measured(controller, env_id, episodes, *more)

    monkeypatch.setattr("tensegrity_agents.campaign.evaluate", noted)
    places = tmp_path, tmp_path / "records", silent
    some, whole = (Task(experiment, None, "closed_form_ik", only) for only in ((3,), None))
    ((_, found),) = run_campaign([some], *places)
    assert list(found.successes) == ["", "3"]
    assert some.kept(places[1]) == found
    assert whole.kept(places[1]) is None
    with pytest.raises(KeyboardInterrupt):
        list(run_campaign([whole], *places))
    ((_, found),) = run_campaign([whole], *places)
    assert asked == [{}, {"level": 3}, {"level": 0}, {"level": 1}, {"level": 1}]  # level 2 is the environment as it is
    ((_, at_once),) = run_campaign([whole], tmp_path, tmp_path / "others", silent)
    assert found == at_once


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--only", "lqg"], "'lqg' is none; there are"),
        (["--levels", "0,7"], "whole numbers from 0 to 3"),
        (["--seeds", ""], "--seeds : must be whole numbers"),
        (["--ids", "TwoXReach-v0,tensegrity/TwoXReach-v0"], "must be different ids"),
        (["--ablate", "--only", "controllers"], "ablations are of agents alone"),
    ],
)
def test_slips_of_what_to_measure_are_explained(tmp_path, words, message):
    places = ["--results", str(tmp_path / "a"), "--records", str(tmp_path / "b")]
    done = CliRunner().invoke(app, ["campaign", "--ids", "TwoXReach-v0", *places, *words], env={"COLUMNS": "300"})
    assert done.exit_code == 2
    assert message in done.output


@pytest.mark.parametrize(("words", "count"), [([], 10), (["--seeds", "0,1"], 2)])
def test_a_config_with_more_than_five_seeds_has_them_all(tmp_path, monkeypatch, words, count):
    seen: list[Task] = []
    monkeypatch.setattr(command, "run_campaign", lambda tasks, *_: seen.extend(tasks) or iter(()))
    places = ["--results", str(tmp_path / "results"), "--records", str(tmp_path / "records")]
    for env_id, expected in (("TwoXFastReachMuJoCo-v0", count), ("TwoXReach-v0", min(count, 5))):
        seen.clear()
        done = CliRunner().invoke(app, ["campaign", "--ids", env_id, *places, *words])
        assert done.exit_code == 0, done.output
        assert [task.seed for task in seen if task.seed is not None] == list(range(expected))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": "0"}, "seed: .*integer.*'0'"),
        ({"seed": True}, "seed: .*integer.*True"),
        ({"seed": -1}, "seed: .*greater"),
        ({"seed": None}, "'agent' without a seed is of kind 'baseline'"),
        ({"env": 5}, "env: .*string"),
        ({"controller": 5}, "controller: .*string"),
        ({"kind": "x"}, "kind: 'agent' with seed 0 is of kind 'agent', got 'x'"),
        ({"kind": "oracle", "controller": "servo", "seed": None}, "'servo' without a seed is of kind 'baseline'"),
        ({"episodes": "20"}, "episodes: .*integer"),
        ({"episodes": 20.5}, "episodes: .*integer"),
        ({"episodes": 0}, "episodes: .*greater"),
        ({"episodes": 25}, "24 bits for 25 episodes"),
        ({"episodes": 19}, "more than 19 flags for 19 episodes"),
        ({"episodes": 24}, "20 settling times for 24 episodes"),
        ({"successes": {}}, "successes: there are none of the environment as it is"),
        ({"successes": []}, "successes: "),
        ({"successes": {"": 5}}, "successes: : .*string"),
        ({"successes": {"": "fffff0", "x": "fffff0"}}, "no level 'x'; there are 0, 1, 2, 3"),
        ({"successes": {"": "fffxf0"}}, "hexadecimal"),
        ({"settling": {"3": "0" * 80}}, "settling: there are no successes at level '3'"),
        ({"settling": {"": "0" * 79}}, "fromhex"),
        ({"config": None}, "config: .*string"),
        ({"knows": 5}, "knows: .*string"),
        ({"steps_to_target": "x"}, "steps_to_target: .*number"),
        ({"steps_to_target": np.nan}, "steps_to_target: .*"),
        ({"frames": "many"}, "frames: .*integer"),
        ({"cpu_seconds": "x"}, "cpu_seconds: .*number"),
        ({"wall_seconds": -1.0}, "wall_seconds: .*greater"),
        ({"colour": "red"}, "colour: "),
    ],
)
def test_a_field_changed_into_what_cannot_be_is_named(tmp_path, changes, message):
    path = tmp_path / "agent-0.json"
    WHOLE.write(path)
    assert read_record(path) == WHOLE
    path.write_text(json.dumps(asdict(WHOLE) | changes))
    with pytest.raises(ValueError, match=rf"^\S*agent-0\.json: not a record of this package \(.*{message}") as error:
        read_record(path)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("text", [b'{"env": "x"}', b"", b"[]", b"3", b"{", b"\xff\xfe"])
def test_a_foreign_file_is_named(tmp_path, text):
    path = tmp_path / "agent-0.json"
    path.write_bytes(text)
    with pytest.raises(ValueError, match=r"agent-0\.json: not a record.*delete it"):
        read_record(path)


def test_files_of_rows_stay_what_they_are():
    """All rows of the repository are read, and those of today's fields are written as they were."""
    for path in (ROOT / "records").glob("**/*.json"):
        text = path.read_text()
        found = read_record(path)
        assert {**asdict(found), **json.loads(text)} == asdict(found)
        if "settling" in json.loads(text):
            assert json.dumps(asdict(found), indent=1) + "\n" == text


@pytest.mark.parametrize(
    ("seed", "changes"),
    [
        (None, {"episodes": 12}),
        (None, {"env": "tensegrity/ThreeXReach-v0"}),
        (None, {"controller": "servo"}),
        (None, {"kind": "agent", "seed": 0}),
        (0, {"seed": 1}),
        (0, {"kind": "baseline", "seed": None}),
    ],
)
def test_a_row_that_is_not_what_is_asked_for_is_not_taken(tmp_path, seed, changes):
    task = Task(Experiment(**SMALL), seed, "" if seed is not None else "closed_form_ik")
    name, kind = ("PPO agent", "agent") if seed is not None else (task.controller, "baseline")
    row = Record(task.experiment.env, name, kind, 13, {"": "fff0"}, task.config, seed=seed)
    row.write(task.file(tmp_path))
    assert task.kept(tmp_path) == row
    replace(row, **changes).write(task.file(tmp_path))
    assert task.kept(tmp_path) is None


@pytest.mark.parametrize("text", ["", "{", '"x"', "NaN", "-1", "true", "[1]"])
def test_a_damaged_count_of_time_costs_the_number_alone(tmp_path, monkeypatch, text):
    task = Task(Experiment(**SMALL), 0)
    home = task.home(tmp_path / "results")
    home.mkdir(parents=True)
    (home / "policy.json").touch()  # a training goes on
    (home / "cpu_seconds.json").write_text(text)
    agent = SimpleNamespace(knows="", description={"timesteps": 64, "training_seconds": 1.0})
    monkeypatch.setattr("tensegrity_agents.campaign.train_agents", lambda *_: {0: agent})
    monkeypatch.setattr("tensegrity_agents.campaign.recorded", lambda *_, **more: replace(WHOLE, **more))
    monkeypatch.setattr("tensegrity_agents.campaign._evaluated", lambda *_: None)
    ((_, row),) = run_campaign([task], tmp_path / "results", tmp_path / "records", silent)
    assert row.cpu_seconds is None


def test_the_policy_is_kept_though_levels_were_not_measured(tmp_path):
    settings = {"env": "TwoXTensionReachUncertain-v0", "seeds": [0], "controllers": [], "episodes": 5}
    experiment = Experiment(**SMALL | settings)
    folders = [tmp_path / name for name in ("results", "records", "policies")]
    ((_, row),) = run_campaign(tasks_of(experiment, levels=(0,)), *folders[:2], silent)
    assert list(row.successes) == ["", "0"]
    home = keep_median(experiment, *folders)
    assert home is not None and (home / FLAGS).is_file()


def test_shipped_policies_are_the_medians_of_the_kept_rows():
    rows = read_records(ROOT / "records")
    for home in (path.parent for path in FOLDER.glob("*/policy.json")):
        agents = [row for row in rows[f"tensegrity/{home.name}"] if row.kind == "agent"]
        chosen = median_record(agents)
        assert json.loads((home / "policy.json").read_text())["seed"] == chosen.seed
        assert (home / FLAGS).read_text().strip() == "".join("01"[flag] for flag in chosen.flags().astype(int))


def test_kept_rows_are_of_environments_that_there_are():
    rows = read_records(ROOT / "records")
    assert set(rows) <= set(ENV_IDS)
    experiments = [load_experiment(path) for path in (ROOT / "configs").glob("*.yaml")]
    fewer = {experiment.env: experiment.episodes for experiment in experiments if experiment.episodes < 1000}
    assert all(row.episodes == fewer.get(row.env, 1000) for group in rows.values() for row in group)
