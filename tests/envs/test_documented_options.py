"""The table of docs/environments.md says of every id what can be randomized. Run this file to write it anew."""

from pathlib import Path

import gymnasium as gym
import pytest

import tensegrity_envs

PAGE = Path(__file__).parents[2] / "docs" / "environments.md"
MARK = "<!-- generated: python tests/envs/test_documented_options.py -->\n"
NAMES = ("stiffness", "mass", "damping", "payload", "actuation_delay", "tip_noise", "angle_noise")


def table() -> str:
    """The table, as Markdown."""
    lines = [f"| id | {' | '.join(NAMES)} |", "|---|" + ":-:|" * len(NAMES)]
    for env_id in tensegrity_envs.ENV_IDS:
        known = gym.make(env_id).unwrapped.core.randomizable
        cells = ["x" if name in known else "" for name in NAMES]
        lines.append(f"| `{env_id.removeprefix('tensegrity/')}` | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def test_the_table_is_true():
    pytest.importorskip("mujoco")
    assert PAGE.read_text().split(MARK)[1].strip() == table().strip()


if __name__ == "__main__":
    text = PAGE.read_text().split(MARK)[0]
    PAGE.write_text(f"{text}{MARK}\n{table()}")
