"""The pages of the environments name everything that an environment hands out, and every reason for which it ends."""

import importlib.util
import re
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import tensegrity_envs
from tensegrity_agents.controllers import baselines_of
from tensegrity_envs.info import meanings_of
from tensegrity_envs.registration import ENTRIES, Entry
from tensegrity_envs.vector_env import step_info

pytest.importorskip("mujoco")
DOCS = Path(__file__).parents[1] / "docs"
every_entry = pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.id)


@pytest.fixture(scope="module")
def pages():
    sys.path.insert(0, str(DOCS))
    try:
        spec = importlib.util.spec_from_file_location("pages", DOCS / "pages.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        yield module
    finally:
        sys.path.remove(str(DOCS))


def section(page, title):
    return re.search(rf"^## {title}$\n(.*?)(?=^## |\Z)", page, re.DOTALL | re.MULTILINE).group(1)


def first_cells(text):
    return re.findall(r"^\| \**`?([^`|*]+?)`?(?:\*\*[^|]*)? \|", text, re.MULTILINE)[2:]


@every_entry
def test_a_page_names_what_there_is(pages, entry):
    core = gym.make(entry.id).unwrapped.core
    page = pages.page(entry)
    assert page.startswith(f"# {entry.id.removeprefix('tensegrity/')}\n")
    assert list(core.schema.fields) == re.findall(r"^\| [\d-]+ \| `(\w+)`", section(page, "Observation"), re.MULTILINE)
    assert set(first_cells(section(page, "Info"))) == set(meanings_of(core))
    assert set(first_cells(section(page, "Randomization"))) == set(core.randomizable)
    named = first_cells(section(page, "Baselines and results"))
    assert [name for name in named if name != "agents"] == list(baselines_of(entry.id))
    for name in first_cells(section(page, "Reward")):
        assert getattr(core.task.weights, name) >= 0
    assert f"| {pages._NONE} |" not in section(page, "Reward")
    for option in entry.options:
        assert f"| `{option}` | `{entry.options[option]!r}` |" in section(page, "Options")


@every_entry
def test_every_reason_for_which_random_actions_end_an_episode_is_on_the_page(pages, entry):
    envs = gym.make_vec(entry.id, 64, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    envs.reset(seed=3)
    rng = np.random.default_rng(3)
    seen = set()
    for k in range(120):  # steps of one direction go farther than steps of all
        if k % 10 == 0:
            actions = rng.uniform(-1, 1, envs.action_space.shape)
        info = step_info(envs.step(actions)[4])
        seen |= {tensegrity_envs.termination_reason(int(code)) for code in np.unique(info["failure"])}
    ends = " ".join(section(pages.page(entry), "What ends an episode").split())
    assert all(f'"{reason}"' in ends for reason in seen - {""}), seen


def test_films_and_pages_are_written_and_old_ones_removed(pages, tmp_path):
    old = tmp_path / "TwoXRaech-v0.md"
    old.write_text("# of an id that is gone\n")
    chosen = [entry for entry in ENTRIES if entry.id == "tensegrity/DualTrianglePush-v0"]
    pages.write_all(tmp_path, chosen)
    assert not old.exists()
    assert (tmp_path / "DualTrianglePush-v0.gif").stat().st_size > 1000
    assert "DualTrianglePush-v0.gif" in (tmp_path / "DualTrianglePush-v0.md").read_text()


def test_an_id_that_was_never_measured_has_a_page(pages):
    new = Entry("tensegrity/TwoXNewReach-v0", "an arm", "TwoXReach", {"control": "tension"})
    gym.register(
        new.id,
        entry_point="tensegrity_envs.env:ManipulatorEnv",
        vector_entry_point="tensegrity_envs.vector_env:ManipulatorVectorEnv",
        kwargs={"arm": new.arm, **new.options},
    )
    try:
        page = pages.page(new)
    finally:
        del gym.registry[new.id]
    assert "It has not been measured yet." in page and "`oracle`" in page


def test_the_command_prints_a_page(pages, capsys):
    assert pages.main(["TwoXReach-v0"]) == 0
    assert capsys.readouterr().out.startswith("# TwoXReach-v0\n")
    assert pages.main(["TwoXRaech-v0"]) == 2
    assert "TwoXReach-v0" in capsys.readouterr().err
