"""The program `tensegrity`: every subcommand, slips, what machines read, and policies."""

import errno
import json
import math
import re
import shutil
import subprocess
import sys

import pytest
import typer
from drawn_analyses import DESIGNS
from typer.testing import CliRunner

import tensegrity_envs
from tensegrity_agents import benchmark
from tensegrity_agents.command import SUBCOMMANDS
from tensegrity_agents.command.list import described, detailed
from tensegrity_agents.command.program import app, load
from tensegrity_agents.command_options import (
    EnvironmentOptions,
    ExperimentOptions,
    completed_ids,
    find_experiment,
    shipped_configs,
)
from tensegrity_agents.config import ConfigError
from tensegrity_agents.console import clear_errors, tell_json
from tensegrity_agents.pretrained import load_pretrained

PROGRAM = "from tensegrity_agents.command import run; run()"


def done(*arguments):
    """What became of a command; an exception of ours is raised."""
    result = CliRunner().invoke(app, list(arguments), env={"COLUMNS": "200", "TERMINAL_WIDTH": "200"})
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def run(*arguments):
    """The exit code, and all that was printed."""
    result = done(*arguments)
    return result.exit_code, result.output


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
    code, text = run("list")
    assert code == 0
    assert max(map(len, text.splitlines())) <= 110
    told = " ".join(text.split())
    for row in rows:
        short = row["id"].removeprefix("tensegrity/")
        assert sum(one.startswith(short + " ") for one in text.splitlines()) == 1
        assert f"{row['summary']}; {', '.join(row['baselines'])}" in told


@pytest.mark.parametrize("name", ["TwoXPayloadReach-v0", "tensegrity/TwoXPayloadReach-v0"])
def test_list_tells_all_about_one(name):
    code, text = run("list", name, "--json")
    row = json.loads(text)
    assert (code, row["id"], row["tolerance"]) == (0, "tensegrity/TwoXPayloadReach-v0", 0.005)
    assert set(row["observed"]) == {"tip", "tensions"}
    assert row["an_action_of_1"] == "moves the cable tensions by 15 N in a step"
    code, text = run("list", name)
    assert code == 0
    assert "position of the tip [m]" in text and "tensegrity compare TwoXPayloadReach-v0" in text


@pytest.mark.parametrize("env_id", tensegrity_envs.ENV_IDS)
def test_all_about_one_is_there_for_every_environment(env_id):
    if "MuJoCo" in env_id:
        pytest.importorskip("mujoco")
    row = detailed(described(env_id, ""))
    assert f"tolerance {row['tolerance']:.5g}" in row["goal"]
    assert len(row["observed"]) > 0


WITH_AN_ENVIRONMENT = ("train", "compare", "evaluate", "transfer", "tune", "watch", "play")


@pytest.mark.parametrize("name", WITH_AN_ENVIRONMENT)
@pytest.mark.parametrize("words", ["TwoXReach-v0", "tensegrity/TwoXReach-v0", "--env TwoXReach-v0"])
def test_the_environment_is_an_argument_everywhere_and_may_be_an_option(name, words):
    command = load(name)
    context = command.make_context(name, words.split())
    given = context.params["environment"] or context.params["env"]
    assert given == words.split()[-1]
    assert {parameter.name for parameter in command.params} >= {"environment", "env"}


def test_ids_complete_with_and_without_their_namespace():
    names = [name for name, _ in completed_ids("TwoXP")]
    assert names == ["TwoXPayloadReach-v0", "TwoXPostureChange-v0", "TwoXPayloadReachUncertain-v0"]
    assert [name for name, _ in completed_ids("tensegrity/TwoXP")] == [f"tensegrity/{name}" for name in names]
    assert len(completed_ids("")) == len(tensegrity_envs.ENV_IDS)


def test_a_shell_completes_ids_without_waiting_for_torch():
    typed = ["compare TwoXPo", "evaluate --env TwoXPo", "list TwoXPo", "compile TwoXPo"]
    code = f"""
import os, sys
from tensegrity_agents.command import run
for words in {[f"tensegrity {one}" for one in typed]}:
    asked = {{"_TENSEGRITY_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}}
    os.environ.update(asked)
    try:
        run()
    except SystemExit:
        print("torch" in sys.modules)
"""
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert shown.stdout.split() == ["TwoXPostureChange-v0", "False"] * len(typed), shown.stderr


def test_json_is_all_that_standard_output_has(tmp_path):
    told = done("evaluate", "TwoXReach-v0", "--controller", "closed_form_ik", "--episodes", "3", "--json")
    (row,) = json.loads(told.stdout)
    assert (told.exit_code, row["controller"], row["episodes"]) == (0, "closed_form_ik", 3)
    assert row["score"] is None  # the task has none, and JSON no NaN
    config = tmp_path / "config.yaml"
    config.write_text(
        "env: TwoXReach-v0\nepisodes: 3\ncontrollers: [closed_form_ik]\n"
        "train: {total_timesteps: 64, net_arch: [4], ppo: {num_envs: 4, n_steps: 8}}\n"
    )
    told = done("compare", "--config", str(config), "--out", str(tmp_path / "out"), "--json")
    assert (told.exit_code, [row["kind"] for row in json.loads(told.stdout)]) == (0, ["agent", "baseline"])
    assert "report:" in told.stderr
    records = shipped_configs().parent / "records"
    if records.is_dir():  # they are no part of a wheel
        for name in ("TwoXReach-v0", "TwoXTensionReachUncertain-v0"):  # both figures of two rows, not of all
            shutil.copytree(records / name, tmp_path / "records" / name)
        told = done("matrix", "--records", str(tmp_path / "records"), "--out", str(tmp_path), "--json")
        assert told.exit_code == 0
        assert all(row["wins"] in ("agent", "controller", "level", "\N{EN DASH}") for row in json.loads(told.stdout))
    # Of all mechanisms, `drawn` sees that nothing is printed: here, the one that is drawn soonest.
    told = done("analyze", "two-x", "--design", DESIGNS["two-x"][-1], "--out", str(tmp_path / "analysis"), "--json")
    assert told.exit_code == 0
    assert all(numbers for numbers in json.loads(told.stdout).values())


def test_json_knows_no_nan(capsys):
    tell_json({"a": [math.nan, 1.0, (math.inf,)], "b": "x"})
    assert json.loads(capsys.readouterr().out) == {"a": [None, 1.0, [None]], "b": "x"}


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ValueError("a slip"), 2),
        (ConfigError("a slip"), 2),
        (FileNotFoundError(errno.ENOENT, "no such file", "x"), 2),
        (OSError(errno.ENOSPC, "no space left", "x"), 1),
        (KeyboardInterrupt(), 130),
    ],
)
def test_exit_codes_tell_slips_from_failures(error, code):
    with pytest.raises(typer.Exit) as ended, clear_errors():
        raise error
    assert ended.value.exit_code == code


def test_faults_of_the_program_are_not_hidden():
    with pytest.raises(ZeroDivisionError), clear_errors():
        raise ZeroDivisionError
    with pytest.raises(ModuleNotFoundError), clear_errors():
        import tensegrity_envs.no_such_module  # noqa: F401


def without_mujoco(*words):
    """The program where MuJoCo is not installed."""
    code = (
        "import importlib.util as u, sys; f = u.find_spec; sys.modules['mujoco'] = None; "
        f"u.find_spec = lambda n, *a: None if n == 'mujoco' else f(n, *a); sys.argv[1:] = {list(words)}; {PROGRAM}"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_controllers_and_configs_do_not_need_mujoco():
    code = "import sys; sys.modules['mujoco'] = None; import tensegrity_agents.config, tensegrity_agents.pretrained"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert shown.returncode == 0, shown.stderr


@pytest.mark.usefixtures("only_one_policy")
def test_the_shipped_policy_is_scored_by_its_name():
    code, text = run("evaluate", "TwoXReach-v0", "--controller", "agent", "--episodes", "60", "--json")
    assert code == 0, text
    assert '"agent"' in text
    code, text = run("evaluate", "TwoXTensionReachUncertain-v0", "--controller", "agent", "--episodes", "60")
    assert code == 2
    assert "no policy is shipped for" in text


@pytest.mark.parametrize(("env_id", "is_shipped"), [("TwoXReach-v0", True), ("TwoXTensionReachUncertain-v0", False)])
@pytest.mark.usefixtures("only_one_policy")
def test_evaluate_says_where_a_policy_is_shipped(env_id, is_shipped):
    code, text = run("evaluate", env_id, "--episodes", "3")
    assert (code, "--controller agent scores it" in text) == (0, is_shipped)
    _, text = run("evaluate", env_id, "--episodes", "3", "--controller", "random")
    assert "--controller agent" not in text


def test_the_folder_of_a_film_is_made(tmp_path):
    film = tmp_path / "new" / "folder" / "film.gif"
    code, text = run("watch", "TwoXReach-v0", "--record", str(film), "--episodes", "1")
    assert code == 0, text
    assert film.stat().st_size > 1000


@pytest.mark.full
def test_without_mujoco_the_rest_is_compiled():
    shown = without_mujoco("compile")
    assert shown.returncode == 0, shown.stderr
    assert "dynamic environments are left out" in shown.stdout


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        ("nothing", "No such command"),
        ("evalute TwoXReach-v0", "Did you mean 'evaluate'?"),
        ("evaluate TwoXReach-v0 --controller closed_from_ik", "did you mean 'closed_form_ik'?"),
        ("watch TwoXReach", "did you mean TwoXReach-v0"),
        ("watch TwoXReach-v0 --record film.avi", "must end in .gif or .mp4"),
        ("watch TwoXReach-v0 --record {here}/none/film.gif --controller nobody", "there are closed_form_ik"),
        ("watch TwoXReach-v0 --controller oracle --policy {here}", "give one of them"),
        ("watch TwoXReach-v0 --policy {here} --record {here}/film.gif", "policy.safetensors"),
        ("compile TwoX", "did you mean"),
        ("bench --ids twoxreach", "did you mean TwoXReach-v0"),
        ("campaign --ids TwoXReach-v0,TwoXReech-v0", "did you mean TwoXReach-v0"),
        ("export ThreeXReech-v0 policy.onnx", "did you mean ThreeXReach-v0"),
        ("evaluate Nothing-v0", "no environment 'Nothing-v0'; `tensegrity list` tells all"),
        ("play TwoX", "did you mean"),
        ("compare TwoXReach", "did you mean TwoXReach-v0"),
        ("train TwoXReach-v0 --env TwoXReach-v0", "give one of them"),
        ("evaluate TwoXReach-v0 --env TwoXReach-v0", "give one of them"),
        ("list TwoXReach", "did you mean TwoXReach-v0"),
    ],
)
def test_a_slip_is_one_message(arguments, answer, tmp_path):
    code, text = run(*arguments.format(here=tmp_path).split())
    assert code == 2
    assert answer in text


def test_a_mistyped_id_is_answered_with_few_others():
    """And not with a wall of all there are."""
    _, text = run("evaluate", "TwoXTensionReech-v0")
    assert "TwoXTensionReach-v0" in text
    assert 0 < sum(f"{name.removeprefix('tensegrity/')}" in text for name in tensegrity_envs.ENV_IDS) <= 3


@pytest.mark.parametrize("prefix", ["", "tensegrity/"])
def test_bench_takes_ids_with_and_without_their_namespace(prefix, monkeypatch):
    asked = []
    monkeypatch.setattr(benchmark, "compiling", lambda ids, _: asked.extend(ids) or [])
    code, text = run("bench", "--only", "compiling", "--ids", f"{prefix}TwoXReach-v0, {prefix}ThreeXReach-v0")
    assert (code, asked) == (0, ["tensegrity/TwoXReach-v0", "tensegrity/ThreeXReach-v0"]), text


def test_watch_films_the_shipped_policy(tmp_path):
    film = tmp_path / "film.gif"
    code, text = run("watch", "TwoXReach-v0", "--record", str(film), "--episodes", "1", "--seed", "3")
    assert (code, film.stat().st_size > 10_000) == (0, True)
    assert "shipped policy" in text
    assert "seed 3: on target" in text
    assert re.search(r"film .* (\d+)/\1 ", text)


def test_watch_writes_mp4(tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    film = tmp_path / "film.mp4"
    code, _ = run("watch", "--env", "TwoXPostureChange-v0", "--record", str(film), "--episodes", "1")
    assert (code, film.read_bytes()[4:8]) == (0, b"ftyp")


@pytest.mark.parametrize(
    ("name", "env_id"), [("play", "TwoXReach-v0"), ("watch", "TwoXReach-v0"), ("watch", "TwoXTensionReachMuJoCo-v0")]
)
def test_a_window_needs_a_display_before_anything_is_loaded(name, env_id, monkeypatch):
    if "MuJoCo" in env_id:
        pytest.importorskip("mujoco")
    for variable in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(variable, raising=False)
    code, text = run(name, env_id)
    assert code == 2
    assert "no display" in text and "policy" not in text
    assert "ssh -X" in text and "--record film.gif" in text and "render_mode" not in text


def test_any_option_of_an_environment_counts_everywhere(tmp_path):
    more = ("DualTriangleReach-v0", "--option", "segments=2")
    code, text = run("evaluate", *more, "--controller", "pseudo_inverse", "--episodes", "5")
    assert code == 0
    assert "segments: 2" in text and "pseudo_inverse" in text
    code, text = run("watch", *more, "--record", str(tmp_path / "film.gif"), "--episodes", "1")
    assert code == 0
    assert "the shipped policy does not fit" in text and "oracle does not fit" in text and "on target" in text
    options = EnvironmentOptions(option=["segments=2", "reward_type=sparse"])
    experiment, folder = ExperimentOptions(environment=more[0]).chosen(options)
    assert experiment.options == {"segments": 2, "reward_type": "sparse"} == experiment.env_options
    assert experiment.training_options["segments"] == 2
    assert folder.name != "DualTriangleReach-v0"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("segments", "must be name=value"),
        ("segments=[", "not YAML"),
        ("level=1", "an option of its own, --level"),
        ("render_mode=human", "no option of environments"),
        ("max_episode_steps=5", "no option of environments"),
        ("sgments=4", "sgments"),
    ],
)
def test_slips_in_options_of_environments_are_told(given, message):
    code, text = run("evaluate", "DualTriangleReach-v0", "--option", given)
    assert code == 2
    assert message in " ".join(text.split())


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("Nope-v0", "Nope-v0, which is no environment of this package$"),
        ("TwoXReach", "which is no environment of this package: did you mean TwoXReach-v0"),
        ("TwoXTensionReachUncertain-v0", "`tensegrity train TwoXTensionReachUncertain-v0`"),
    ],
)
@pytest.mark.usefixtures("only_one_policy")
def test_policies_that_are_not_shipped_are_told(name, message):
    with pytest.raises(ValueError, match=f"no policy is shipped for .*{message}"):
        load_pretrained(name)


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


def test_configs_come_with_the_package(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_experiment(None, "TwoXTensionReach-v0").env == "tensegrity/TwoXTensionReach-v0"
    assert list(shipped_configs().glob("*.yaml"))
    with pytest.raises(ConfigError, match=r"no config for tensegrity/TwoXReach-v0 in .*; --config takes a file"):
        find_experiment(None, "TwoXReach-v0", tmp_path)
