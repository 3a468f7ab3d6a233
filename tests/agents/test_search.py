"""Hyperparameter search: its own settings first, it goes on after an interrupt, and its result is a config."""

import csv

import pytest
from typer.testing import CliRunner

from tensegrity_agents import search as search_module
from tensegrity_agents.command.program import app
from tensegrity_agents.config import ConfigError, Experiment, load_experiment
from tensegrity_agents.sb3 import training
from tensegrity_agents.search import Between, OneOf, search, space_of

optuna = pytest.importorskip("optuna")

TINY = {"total_timesteps": 64, "net_arch": [4], "ppo": {"num_envs": 4, "n_steps": 8}}
EXPERIMENT = Experiment(env="TwoXReach-v0", train=TINY, controllers=["closed_form_ik"], seeds=[3, 4])


def rows_of(folder):
    with (folder / "trials.csv").open() as file:
        return list(csv.DictReader(file))


def quietly(text):
    pass


def test_the_result_is_a_config_with_all_steps(tmp_path):
    best, score = search(EXPERIMENT, tmp_path, 3, share=0.5, episodes=5, remark=quietly)
    found = load_experiment(best)
    assert (found.env, found.seeds, found.train.total_timesteps) == (EXPERIMENT.env, [3, 4], 64)
    rows = rows_of(tmp_path)
    assert len(rows) == 3
    assert float(rows[0]["ppo.learning_rate"]) == EXPERIMENT.train.ppo.learning_rate  # the config's own come first
    assert rows[0]["net_arch"] == "[4]"
    assert score == max(float(row["success"]) for row in rows if row["state"] == "complete")
    assert 0 <= score <= 1
    assert f"{score:.1%}" in best.read_text()
    assert search(EXPERIMENT, tmp_path, 3, share=0.5, episodes=5, remark=quietly) == (best, score)  # they are there
    with pytest.raises(ConfigError, match="of another experiment"):
        search(EXPERIMENT.changed(seeds=[5]), tmp_path, 3, share=0.5)


def test_after_an_interrupt_the_same_settings_go_on(tmp_path, monkeypatch):
    tried, usual = [], training.train

    def noted(experiment, seed, home, report):
        tried.append((experiment.train, seed, home))
        if len(tried) == 2:
            raise KeyboardInterrupt
        return usual(experiment, seed, home, report)

    monkeypatch.setattr(training, "train", noted)
    with pytest.raises(KeyboardInterrupt):
        search(EXPERIMENT, tmp_path, 3, episodes=5, remark=quietly)
    search(EXPERIMENT, tmp_path, 3, episodes=5, remark=quietly)
    assert tried[2] == tried[1]
    assert len(tried) == 4
    assert {seed for _, seed, _ in tried} == {3}
    assert [row["state"] for row in rows_of(tmp_path)] == ["complete", "fail", "complete", "complete"]


def test_settings_that_do_not_go_together_are_passed_over(tmp_path, monkeypatch):
    usual, remarks, asked = search_module._with, [], []

    def refused(experiment, settings):
        if settings not in asked:
            asked.append(settings)
        if settings == asked[-1] and len(asked) == 2:
            raise ConfigError("these two do not go together")
        return usual(experiment, settings)

    monkeypatch.setattr(search_module, "_with", refused)
    search(EXPERIMENT, tmp_path, 3, episodes=5, remark=remarks.append)
    assert remarks[1] == "trial 1: these two do not go together"
    assert [row["state"] for row in rows_of(tmp_path)] == ["complete", "pruned", "complete"]


def test_a_trial_that_is_behind_is_given_up(tmp_path, monkeypatch):
    count = 0

    def pretended(experiment, seed, home, report):
        nonlocal count
        count += 1
        for done in range(0, 101, 10):
            report(done, 100, 0.9 if count < 8 else 0.1)

    class Score:
        columns = {"success": __import__("numpy").array([1.0])}  # noqa: RUF012

    monkeypatch.setattr(training, "train", pretended)
    monkeypatch.setattr("tensegrity_agents.search.evaluate", lambda *_: Score)
    told = []
    search(EXPERIMENT, tmp_path, 9, remark=told.append)
    assert told[7:] == ["trial 7: given up", "trial 8: given up"]


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_every_setting_is_one_of_the_config_and_its_own_value_is_within(algorithm):
    own = Experiment(env="TwoXReach-v0", train=TINY | {"algorithm": algorithm, "off_policy": {"learning_rate": 0.5}})
    for key, span in space_of(own).items():
        section, _, name = key.rpartition(".")
        value = getattr(getattr(own.train, section) if section else own.train, name)
        trial = optuna.trial.FixedTrial({key: value if isinstance(span, Between) else f"{value}"})
        assert span.suggest(trial, key, value) == value
        assert isinstance(span, OneOf) or span.low < span.high


def test_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.yaml").write_text(
        "env: TwoXReach-v0\ntrain: {total_timesteps: 64, net_arch: [4], ppo: {num_envs: 4, n_steps: 8}}\n"
    )
    words = ["search", "--config", "tiny.yaml", "--trials", "1", "--episodes", "5"]
    done = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert done.exit_code == 0, done.output
    assert "tensegrity compare --config results/TwoXReach-v0-search/best.yaml" in done.output
    assert load_experiment(tmp_path / "results/TwoXReach-v0-search/best.yaml").train.total_timesteps == 64
    done = CliRunner().invoke(app, ["search", "TwoXRech-v0"])
    assert (done.exit_code, "did you mean" in done.output) == (2, True)
