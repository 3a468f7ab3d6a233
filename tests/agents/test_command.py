"""The program `tensegrity`: every subcommand, slips, what machines read, and the policies that come with it."""

import json
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

import tensegrity_envs
from tensegrity_agents.command import SUBCOMMANDS
from tensegrity_agents.command.play import action_of
from tensegrity_agents.command.program import app
from tensegrity_agents.command_options import find_experiment, shipped_configs
from tensegrity_agents.config import ConfigError
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.pretrained import FOLDER, load_pretrained, pretrained_ids
from tensegrity_envs.seeding import TEST_SEED

PROGRAM = "from tensegrity_agents.command import run; run()"


def run(*arguments):
    """The exit code, and all that was printed."""
    done = CliRunner().invoke(app, list(arguments), env={"COLUMNS": "200", "TERMINAL_WIDTH": "200"})
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code, done.output


def test_help_lists_every_subcommand_and_loads_no_torch():
    code = f"import sys; sys.argv[1:] = ['--help']\ntry:\n    {PROGRAM}\nfinally:\n    print('torch' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.rstrip().endswith("False")
    assert all(name in shown for name in SUBCOMMANDS)


@pytest.mark.parametrize("name", SUBCOMMANDS)
def test_every_subcommand_explains_itself(name):
    code, text = run(name, "--help")
    assert code == 0
    assert f"tensegrity {name}" in text


def test_list_tells_every_environment():
    code, text = run("list", "--json")
    rows = json.loads(text)
    assert code == 0
    assert [row["id"] for row in rows] == list(tensegrity_envs.ENV_IDS)
    assert all(row["baselines"] and row["max_episode_steps"] > 0 for row in rows)
    assert run("list")[0] == 0


def without_mujoco(*words):
    """The program where MuJoCo is not installed."""
    code = (
        "import importlib.util as u, sys; f = u.find_spec; sys.modules['mujoco'] = None; "
        f"u.find_spec = lambda n, *a: None if n == 'mujoco' else f(n, *a); sys.argv[1:] = {list(words)}; {PROGRAM}"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


@pytest.mark.full
def test_without_mujoco_the_rest_is_compiled():
    shown = without_mujoco("compile")
    assert shown.returncode == 0, shown.stderr
    assert "dynamic environments are left out" in shown.stdout


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        ("nothing", "No such command"),
        ("watch TwoXReach", "did you mean tensegrity/TwoXReach-v0"),
        ("watch TwoXReach-v0 --record film.avi", "must end in .gif or .mp4"),
        ("watch TwoXReach-v0 --record {here}/none/film.gif --controller nobody", "there are closed_form_ik"),
        ("watch TwoXReach-v0 --controller oracle --policy {here}", "give one of them"),
        ("watch TwoXReach-v0 --policy {here} --record {here}/film.gif", "policy.safetensors"),
        ("compile TwoX", "did you mean"),
        ("play TwoX", "did you mean"),
        ("compare TwoXReach", "did you mean tensegrity/TwoXReach-v0"),
        ("train TwoXReach-v0 --env TwoXReach-v0", "give one of them"),
    ],
)
def test_a_slip_is_one_message(arguments, answer, tmp_path):
    code, text = run(*arguments.format(here=tmp_path).split())
    assert code == 2
    assert answer in text


def test_watch_films_the_shipped_policy(tmp_path):
    film = tmp_path / "film.gif"
    code, text = run("watch", "TwoXReach-v0", "--record", str(film), "--episodes", "1", "--seed", "3")
    assert (code, film.stat().st_size > 10_000) == (0, True)
    assert "shipped policy" in text
    assert "seed 3: on target" in text


@pytest.mark.parametrize("name", ["play", "watch"])
def test_a_window_needs_a_display(name, monkeypatch):
    for variable in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(variable, raising=False)
    code, text = run(name, "TwoXReach-v0")
    assert code == 2
    assert "no display" in text
    assert name == "play" or "--record film.gif" in text


def test_what_needs_mujoco_says_so_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for module in [name for name in sys.modules if name.startswith("tensegrity_envs.simulation.mujoco")]:
        if module != "tensegrity_envs.simulation.mujoco.dynamics":
            monkeypatch.delitem(sys.modules, module)
    for arguments in (["list"], ["list", "--json"]):
        code, text = run(*arguments)
        assert code == 0
        assert "tensegrity-envs[mujoco]" in text
    code, text = run("watch", "TwoXTensionReachMuJoCo-v0", "--record", "film.gif")
    assert code == 2
    assert "tensegrity-envs[mujoco]" in text


def test_keys_become_actions():
    np.testing.assert_allclose(action_of({"right", "down"}.__contains__, 3, 0.3), [0.3, -0.3, 0.0], rtol=1e-6)


def test_configs_come_with_the_package(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_experiment(None, "TwoXTensionReach-v0").env == "tensegrity/TwoXTensionReach-v0"
    assert list(shipped_configs().glob("*.yaml"))
    with pytest.raises(ConfigError, match="there are configs for nothing"):
        find_experiment(None, "TwoXReach-v0", tmp_path)


@pytest.mark.parametrize("env_id", pretrained_ids())
def test_a_shipped_policy_does_what_was_recorded(env_id):
    recorded = (FOLDER / env_id.rpartition("/")[2] / "test_successes.txt").read_text().strip()
    found = evaluate(load_pretrained(env_id), env_id, 200, TEST_SEED, "policy").columns["success"]
    differ = sum(bool(now) != (then == "1") for now, then in zip(found, recorded[:200], strict=True))
    assert differ <= 2


def test_policies_are_small_and_one_that_is_missing_is_named():
    assert "tensegrity/TwoXReach-v0" in pretrained_ids()
    assert sum(path.stat().st_size for path in FOLDER.rglob("*")) < 10e6
    with pytest.raises(ValueError, match=r"there are policies for .*tensegrity/TwoXReach-v0"):
        load_pretrained("NoSuchReach-v0")
