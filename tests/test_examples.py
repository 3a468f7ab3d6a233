"""The examples run as written, on fewer episodes; they are worth what they claim, and read no pickle."""

import re
import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "examples"


def rows_of(name, *arguments):
    """The rows of its table by controller."""
    return {row["controller"]: row for row in runpy.run_path(str(FOLDER / name))["main"](list(arguments))}


def test_a_foreign_agent_is_scored(capsys):
    rows = rows_of("foreign_sb3_agent.py", "--steps", "2048", "--episodes", "20")
    assert list(rows) == ["plain PPO agent", "closed_form_ik", "random"]
    assert rows["plain PPO agent"]["kind"] == "agent" and rows["closed_form_ik"]["success"] == 1.0
    assert "plain PPO agent" in capsys.readouterr().out


def test_a_client_of_vectors_is_scored():
    rows = rows_of("box_client.py", "--episodes", "30")
    assert rows["my client"]["success"] > rows["random"]["success"] + 0.2


def test_the_regulator_arrives():
    rows = rows_of("lqr.py", "--episodes", "20")
    assert rows["my LQR"]["success"] >= 0.9


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.name)
def test_no_example_unpickles(path):
    assert not re.search(r"\bimport (pickle|dill|cloudpickle)|\.load\(|torch\.load|joblib", path.read_text())
    assert f"python examples/{path.name}" in path.read_text()
