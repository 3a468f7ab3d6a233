"""Ablations: one thing is taken out at a time, their rows are kept apart, and the table holds them."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from tensegrity_agents.ablations import VARIANTS, variants_of
from tensegrity_agents.command.program import app
from tensegrity_agents.config import ConfigError, Experiment
from tensegrity_agents.evaluation.records import Record, packed, packed_times, read_records
from tensegrity_agents.reporting.ablations import WHOLE, ablations_to_markdown

TRAIN = {
    "total_timesteps": 96,
    "net_arch": [4],
    "history": 2,
    "repeat_failed": 0.5,
    "levels": [0, 2],
    "teacher": {"controller": "careful_oracle", "timesteps": 32, "n_steps": 4, "gradient_steps": 1, "batch_size": 8},
    "ppo": {"num_envs": 4, "n_steps": 8, "batch_size": 8},
}


def test_one_thing_is_taken_out():
    whole = Experiment(env="TwoXTensionReachUncertain-v0", train=TRAIN)
    found = variants_of(whole)
    assert set(found) == set(VARIANTS) - {"no_gradient", "no_plan"}
    own = whole.train.model_dump()
    changed = {name: {k: v for k, v in one.train.model_dump().items() if v != own[k]} for name, one in found.items()}
    assert changed == {
        "no_teacher": {"teacher": None},
        "no_history": {"history": 0},
        "no_fine_tuning": {"total_timesteps": 32},
        "no_repeat_failed": {"repeat_failed": 0.0},
        "no_levels": {"levels": None},
    }
    assert variants_of(Experiment(env="TwoXReach-v0", train={"total_timesteps": 96})) == {}


def test_all_are_trained_as_long_where_that_is_asked():
    whole = Experiment(env="TwoXTensionReachUncertain-v0", train=TRAIN)
    found = variants_of(whole, 64)
    assert set(found) == {WHOLE, *VARIANTS} - {"no_gradient", "no_plan"}
    assert {name: one.train.total_timesteps for name, one in found.items()} == {
        name: 32 if name == "no_fine_tuning" else 64 for name in found
    }
    assert found[WHOLE].train.model_dump() == whole.train.model_dump() | {"total_timesteps": 64}
    with pytest.raises(ConfigError, match="--timesteps 32: must be more than the 32 steps with the teacher"):
        variants_of(whole, 32)
    slip = CliRunner().invoke(app, ["campaign", "--timesteps", "64"], env={"COLUMNS": "200"})
    assert slip.exit_code == 2
    assert "is for --ablate" in slip.output


def test_of_an_agent_that_corrects_a_plan():
    settings = {
        "total_timesteps": 96,
        "corrects": {"controller": "closed_form_plan"},
        "gradient": {"timesteps": 64, "num_envs": 4, "horizon": 8},
    }
    whole = Experiment(env="DualTriangleFastReachMuJoCo-v0", train=settings)
    found = variants_of(whole)
    assert set(found) == {"no_gradient", "no_plan", "no_fine_tuning"}
    assert found["no_gradient"].train.gradient is None
    assert found["no_gradient"].train.corrects is not None
    assert found["no_plan"].train.corrects is None
    assert found["no_fine_tuning"].train.total_timesteps == 64
    shorter = variants_of(whole, 32)
    assert {one.train.total_timesteps for one in shorter.values()} == {32}
    assert shorter[WHOLE].train.gradient.timesteps == 32


def test_the_table_tells_when_arms_in_dynamics_settle(tmp_path):
    """In the mean; an episode in which the tip does not stay counts as long as the whole, 3 s."""
    env, times = "tensegrity/TwoXFastReachMuJoCo-v0", np.array([0.5, 0.7, np.inf, 0.8])
    kept = {"controller": "agent", "kind": "agent", "episodes": 4, "config": "", "frames": 1_000_000}
    rows = [
        Record(env, successes={"": packed(times < 1)}, seed=k, settling={"": packed_times(times + k / 10)}, **kept)
        for k in (0, 1)
    ]
    for row in rows:
        row.write(tmp_path / "no_plan" / "TwoXFastReachMuJoCo-v0" / f"agent-{row.seed}.json")
    whole = [replace(row, settling={}) for row in rows]
    lines = [line.split("|") for line in ablations_to_markdown(tmp_path, {env: whole}).splitlines()[2:]]
    assert [(line[2].strip(), line[-2].strip()) for line in lines] == [("whole", "\N{EN DASH}"), ("no plan", "1.288")]


@pytest.mark.full
def test_the_command_keeps_rows_apart_and_goes_on(tmp_path, monkeypatch):
    small = Experiment(env="TwoXReach-v0", episodes=5, train={**TRAIN, "levels": None, "teacher": None})
    monkeypatch.setattr("tensegrity_agents.command.campaign.find_experiment", lambda *_: small)
    words = ["campaign", "--ids", "TwoXReach-v0", "--seeds", "0", "--results", str(tmp_path / "results")]
    words += ["--records", str(tmp_path / "records"), "--ablate", "--timesteps", "96"]
    first = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert first.exit_code == 0, first.output
    assert "3 of 3 rows" in first.output
    again = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert again.exit_code == 0
    assert read_records(tmp_path / "records") == {}  # no rows of the matrix
    table = ablations_to_markdown(tmp_path / "records" / "ablations", {})
    methods = [line.split("|")[2].strip() for line in table.splitlines()[2:]]
    assert sorted(methods) == ["no history", "no repeat failed", "whole"]
