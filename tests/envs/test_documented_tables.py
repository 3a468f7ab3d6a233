"""The tables of docs/environments.md are current, and everything that is handed out is in them."""

import importlib.util
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import law_rows
import tensegrity_envs
from tensegrity_envs.info import meanings_of
from tensegrity_envs.vector_env import step_info

TOOL = Path(__file__).parents[2] / "docs" / "tables.py"
every_id = pytest.mark.parametrize("env_id", law_rows.ids(tensegrity_envs.ENV_IDS))


@pytest.fixture
def tables():
    pytest.importorskip("mujoco")
    spec = importlib.util.spec_from_file_location("tables", TOOL)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tables_are_current(tables):
    assert tables.main([]) == 0


def test_a_changed_table_is_noticed_and_mended(tables, tmp_path, monkeypatch, capsys):
    page = tmp_path / "environments.md"
    page.write_text(tables.PAGE.read_text().replace("| `TwoXReach-v0` |", "| `TwoXRaech-v0` |"))
    monkeypatch.setattr(tables, "PAGE", page)
    assert tables.main([]) == 1
    assert "--write" in capsys.readouterr().out
    assert tables.main(["--write"]) == 0
    assert tables.main([]) == 0
    assert tables.main(["--wirte"]) == 2


def make(env_id, **options):
    if gym.spec(env_id).kwargs.get("backend") == "mujoco":
        pytest.importorskip("mujoco")
    return gym.make_vec(env_id, 32, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)


RANGES = {"actuation_delay": [0, 2], "tip_noise": 1e-4, "angle_noise": 1e-4, "payload": [0.0, 0.1]}


@every_id
def test_every_entry_of_info_is_documented(env_id):
    core = make(env_id).unwrapped.core
    for randomization in (None, {name: RANGES.get(name, [0.95, 1.05]) for name in core.randomizable}):
        envs = make(env_id, randomization=randomization)
        _, info = envs.reset(seed=0)
        told = meanings_of(envs.unwrapped.core)
        assert set(told) == {name for name in info if not name.startswith("_")}
        assert all(meaning.text and meaning.unit for meaning in told.values())


@every_id
@pytest.mark.parametrize("reward_type", ["dense", "sparse"])
def test_every_term_of_the_reward_is_between_zero_and_its_weight(env_id, reward_type):
    envs = make(env_id, reward_type=reward_type)
    task = envs.unwrapped.core.task
    _, info = envs.reset(seed=1)
    rng = np.random.default_rng(1)
    for _ in range(40):
        names = {key.removeprefix("reward_") for key in info if key.startswith("reward_")}
        assert names == {"success"} or (reward_type == "dense" and "success" in names)
        for name in names:
            weight = getattr(task.weights, name) if reward_type == "dense" else 1.0
            assert (info[f"reward_{name}"] >= 0).all()
            assert (info[f"reward_{name}"] <= weight + 1e-12).all()
        info = step_info(envs.step(rng.uniform(-1, 1, envs.action_space.shape))[4])
