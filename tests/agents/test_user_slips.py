"""Slips at the command line: one message that names what was given and what would work, an exit code, no traceback."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from script_runs import run

import tensegrity_agents.console
from tensegrity_agents.config import Experiment
from tensegrity_agents.sb3.training import train

ROOT = Path(__file__).parents[2]
SCRIPTS = ("train", "evaluate", "compare", "transfer", "analyze", "benchmark")
GOOD = "env: TwoXReach-v0\ntrain: {total_timesteps: 64, net_arch: [4], ppo: {num_envs: 4, n_steps: 8}}\n"
CONTROLLERS = """
class NeedsArguments:
    def __init__(self, core): ...
    def predict(self, *args, **kwargs): ...
class Raises:
    def __init__(self): raise RuntimeError("no licence")
class NoPredict: ...
class PredictRaises:
    def predict(self, observation, state=None, episode_start=None, deterministic=True): return 1 / 0
class WrongShape:
    def predict(self, observation, **others): return observation["achieved_goal"][0], None
class NoState:
    def predict(self, observation, **others): return observation["achieved_goal"]
class Lonely:
    def predict(self, observation): return observation["achieved_goal"], None
number = 3
"""


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("agent")
    settings = {"total_timesteps": 64, "net_arch": [4], "ppo": {"num_envs": 4, "n_steps": 8}}
    train(Experiment(env="TwoXReach-v0", train=settings), 0, folder)
    return folder


@pytest.fixture
def place(tmp_path, monkeypatch, policy):
    """A working directory with configs, files and controllers to stumble over."""
    for name, text in {
        "configs/a.yaml": GOOD,
        "configs/b_empty.yaml": "",
        "configs/c_list.yaml": "- 1\n",
        "configs/d_broken.yaml": "env: [",
        "good.yaml": GOOD,
        "empty.yaml": "",
        "list.yaml": "- 1\n",
        "broken.yaml": "env: [\n",
        "twice.yaml": GOOD + "env: TwoXReach-v0\n",
        "numbers.yaml": GOOD + "1: 2\n",
        "tolerance.yaml": GOOD + "tolerance: wide\n",
        "negative.yaml": GOOD + "tolerance: -1e-3\n",
        "null_train.yaml": "env: TwoXReach-v0\ntrain:\n",
        "no_env.yaml": "train: {total_timesteps: 5}\n",
        "options.yaml": GOOD.replace("total", "env_options: {tolerence: 0.1}, total"),
        "gym.yaml": GOOD.replace("total", "env_options: {render_mode: human}, total"),
        "values.yaml": GOOD.replace("n_steps: 8", "n_steps: 8, value_rollouts: 2").replace(
            "total", "corrects: {controller: servo}, total"
        ),
        "many.yaml": GOOD.replace("total", "history: 1000000, total"),
        "observes.yaml": GOOD.replace("total", "env_options: {observe: tip_and_inputs}, total"),
        "one_step.yaml": GOOD.replace("num_envs: 4, n_steps: 8", "num_envs: 1, n_steps: 1"),
        "net.yaml": GOOD.replace("net_arch: [4]", "net_arch: [-4]"),
        "her.yaml": GOOD.replace("total", "algorithm: sac, off_policy: {learning_starts: 5}, total"),
        "arm.yaml": "b: 0.06\n",
        "arm_unknown.yaml": "breadth: 0.06\n",
        "arm_text.yaml": "b: wide\n",
        "arm_empty.yaml": "",
        "file": "x",
        "slip_controllers.py": CONTROLLERS,
        "broken_module.py": "import nothing_of_this_name\n",
        "syntax_error.py": "def :\n",
        "results/TwoXTensionReach-v0/agent-0/policy.json": "{}",
        "results/TwoXTensionReach-v0/agent-0/policy.safetensors": "",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "agent").symlink_to(policy)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tensegrity_agents.console.console, "_width", 200)
    return tmp_path


EXPERIMENTS = [  # of train.py and compare.py alike
    ("--out file", "file"),
    ("--out file/below", "is a file, not a folder"),
    ("--out /proc/here", "/proc"),
    ("--seeds a,b", "whole numbers"),
    ("--seeds 0,0", "different"),
    ("--seeds 1.5", "whole numbers"),
    ("--seeds 0,,1", "whole numbers"),
    ("--seeds -1", "0 to 899"),
    ("--seeds 900", "0 to 899"),
    ("--seeds=", "whole numbers"),
    ("--config nothing.yaml", "good.yaml"),
    ("--config configs", "no config configs"),
    ("--config folder.yaml", "no config folder.yaml"),
    ("--config empty.yaml", "is empty"),
    ("--config list.yaml", "keys and values"),
    ("--config broken.yaml", "not valid YAML"),
    ("--config binary.yaml", "not a text file"),
    ("--config twice.yaml", "'env' is given twice"),
    ("--config numbers.yaml", "keys must be words"),
    ("--config tolerance.yaml", "tolerance"),
    ("--config negative.yaml", "greater than 0"),
    ("--config null_train.yaml", "train"),
    ("--config no_env.yaml", "env: Field required"),
    ("--config options.yaml", "did you mean 'tolerance'"),
    ("--config gym.yaml", "train.env_options: render_mode is no option of environments, but of gym.make"),
    ("--config gym.yaml --fresh", "render_mode"),
    ("--config values.yaml", "and the policy never"),
    ("--config many.yaml", "less than or equal to 1000"),
    ("--config observes.yaml", "cannot be evaluated"),
    ("--config one_step.yaml", "at least 2"),
    ("--config net.yaml", "net_arch"),
    ("--config her.yaml", "at least one episode"),
    ("--config good.yaml --env DualTriangleReach-v0", "give one of them"),
    ("--env TwoXRech-v0", "did you mean TwoXReach-v0"),
    ("--env [/bold]", "no environment '[/bold]'"),
]
OPTIONS = [  # of train.py, compare.py and evaluate.py alike
    ("--design muralidaran2022", "did you mean 'muralidharan2022'"),
    ("--design ji2014", "muralidharan2022, furet2018"),
    ("--design nothing.yaml", "nothing.yaml cannot be read"),
    ("--design arm_empty.yaml", "is empty"),
    ("--design arm_unknown.yaml", "no field 'breadth'"),
    ("--design arm_text.yaml", "b = 'wide'"),
    ("--design b=", "field=number"),
    ("--design b=-1", "must be positive"),
    ('--design {"b":', "must be JSON"),
    ("--design=", "published design"),
    ("--randomization stiffness", "must be JSON"),
    ("--randomization {stif:[1,2]}", "there is no 'stif'"),
    ("--randomization {stiffness:[2,1]}", "low <= high"),
    ("--randomization {stiffness:[a,b]}", "low <= high"),
    ("--tolerance 0", "tolerance"),
    ("--tolerance nan", "tolerance"),
    ("--tolerance wide", "--tolerance"),
    ("--load-range 0,1", "payload_range"),
    ("--load-range 1,0", "low <= high"),
    ("--load-range a,b", "two numbers"),
    ("--load-range 1", "two numbers"),
    ("--payload-range 0,inf", "finite"),
]
OTHERS = [
    ("compare", "--controller closed_form", "closed_form_ik"),
    ("compare", "--controller slip_controllers:NeedsArguments", "without arguments"),
    ("compare", "--episodes 0", "--episodes"),
    ("evaluate", "--env TwoXRech-v0", "did you mean TwoXReach-v0"),
    ("evaluate", "--split train", "test or validation"),
    ("evaluate", "--episodes 0", "--episodes"),
    ("evaluate", "--csv file/below.csv", "--csv file/below.csv: file is a file, not a folder"),
    ("evaluate", "--csv configs", "is a folder"),
    ("evaluate", "--csv /proc/episodes.csv --episodes 2", "/proc"),
    ("evaluate", "--controller closed_form", "closed_form_ik"),
    ("evaluate", "--controller slip_controllers:NeedsArguments", "without arguments"),
    ("evaluate", "--controller slip_controllers:Raises", "no licence"),
    ("evaluate", "--controller slip_controllers:NoPredict", "no predict"),
    ("evaluate", "--controller slip_controllers:number", "NeedsArguments"),
    ("evaluate", "--controller slip_controllers:", "NeedsArguments"),
    ("evaluate", "--controller slip_controllers:PredictRaises --episodes 2", "ZeroDivisionError"),
    ("evaluate", "--controller slip_controllers:WrongShape --episodes 2", "WrongShape"),
    ("evaluate", "--controller slip_controllers:NoState --episodes 3", "predict raised an error"),
    ("evaluate", "--controller slip_controllers:Lonely --episodes 2", "unexpected keyword argument 'state'"),
    ("evaluate", "--controller broken_module:X", "nothing_of_this_name"),
    ("evaluate", "--controller syntax_error:X", "SyntaxError"),
    ("evaluate", "--policy nothing", "policy.safetensors"),
    ("evaluate", "--policy file", "policy.safetensors"),
    ("evaluate", "--policy results/TwoXTensionReach-v0/agent-0", "not a description"),
    ("evaluate", "--policy agent --env DualTriangleReach-v0", "does not fit"),
    ("transfer", "--env TwoXReach-v0", "has no twin"),
    ("transfer", "--env Nothing-v0", "no environment"),
    ("transfer", "--results file", "is a file, not a folder"),
    ("transfer", "--env TwoXTensionReach-v0", "not a description"),
    ("transfer", "--load-range 1,0", "low <= high"),
    ("transfer", "--design ji2014", "zhao2021_text"),
    ("analyze", "two_x", "two-x"),
    ("analyze", "two-x --design ji2014", "muralidharan2022"),
    ("analyze", "two-x --design nothing.yaml", "nothing.yaml cannot be read"),
    ("analyze", "two-x --design arm_empty.yaml", "is empty"),
    ("analyze", "two-x --design arm_unknown.yaml", "unknown breadth"),
    ("analyze", "two-x --design arm_text.yaml", "b = 'wide'"),
    ("analyze", "two-x --design muralidharan2022,b", "field=number"),
    ("analyze", "two-x --out file", "is a file, not a folder"),
    ("analyze", "two-x --out /proc/here", "/proc"),
    ("benchmark", "--only everything", "redundancy"),
    ("benchmark", "--only ppo --config nothing.yaml", "good.yaml"),
    ("benchmark", "--only ppo --config empty.yaml", "is empty"),
    *((script, "--confg x", "No such option") for script in SCRIPTS),
]
CASES = (
    [(script, *case) for script in ("train", "compare") for case in EXPERIMENTS]
    + [(script, *case) for script in ("train", "compare", "evaluate") for case in OPTIONS]
    + OTHERS
)


@pytest.mark.parametrize(("script", "arguments", "answer"), CASES)
def test_a_slip_is_answered_with_one_message(place, script, arguments, answer):
    before = sorted(path for path in place.rglob("*") if "__pycache__" not in path.parts)
    code, text = run(script, *arguments.split())
    assert code == 2
    assert "Traceback" not in text
    assert "pydantic" not in text
    assert answer in " ".join(text.replace("│", " ").split())
    assert len(re.findall("^error:", text, re.MULTILINE)) == 1 or "Usage" in text
    assert sorted(path for path in place.rglob("*") if "__pycache__" not in path.parts) == before


def test_a_folder_that_cannot_be_written(place):
    """Root may write anywhere, so this one is asked of another user."""
    (place / "locked").mkdir(mode=0o555)
    code = (
        "import os\n"
        "from pathlib import Path; from tensegrity_agents.console import checked_file, checked_folder\n"
        "if os.getuid() == 0: os.setuid(65534)\n"
        "for check, name in ((checked_folder, 'locked/below'), (checked_file, 'locked/a.csv')):\n"
        "    try: check(Path(name), '--out')\n"
        "    except ValueError as error: print(error)\n"
    )
    os.chmod(place, 0o755)
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=place, check=False)
    if "PermissionError" in shown.stderr:
        pytest.skip("the other user cannot even read the temporary folder")
    assert shown.stdout.count("locked/ cannot be written") == 2, shown.stderr


def test_configs_are_found_by_short_ids_and_beside_files_that_are_none(place):
    code, text = run("train", "--env", "TwoXReach-v0", "--out", "out")
    assert code == 0, text
    assert (place / "out" / "agent-0" / "policy.json").is_file()


def test_numbers_as_people_write_them(place):
    (place / "short.yaml").write_text(GOOD + "tolerance: 1e-3\ndesign: {b: 6e-2}\n")
    code, text = run("train", "--config", "short.yaml")
    assert code == 0, text
    assert "design: b = 0.06; all other fields are those of muralidharan2022" in text
    (home,) = (place / "results").glob("TwoXReach-v0-*")
    options = json.loads((home / "agent-0" / "policy.json").read_text())["options"]
    assert options["tolerance"] == 1e-3
    assert options["design"]["b"] == 0.06


@pytest.mark.parametrize("script", SCRIPTS)
def test_help_tells_defaults_and_baselines(script):
    code, text = run(script, "--help")
    told = " ".join(text.replace("│", " ").split())
    assert code == 0
    assert "default: " in told
    if script in ("train", "compare"):
        assert "results/<environment>" in told
    if script == "analyze":
        assert "results/analysis/<mechanism>" in told
    if script in ("evaluate", "compare"):
        assert "tensegrity list ID" in told


def test_analyze_announces_the_files_that_are_there(place):
    (place / "plain.yaml").write_text("base: furet2018\nb: 6e-2\n")
    code, text = run("analyze", "two-x", "--design", "plain.yaml", "--out", "analysis")
    assert code == 0, text
    assert "plain.yaml: b = 0.06; all other fields are those of furet2018" in text
    announced = set()
    for line in text.splitlines():
        if line.startswith("analysis"):
            folder, names = line.split(": ")
            announced |= {place / folder / name for name in names.split(", ")}
    assert announced == {path for path in (place / "analysis").rglob("*.*") if path.is_file()}


@pytest.mark.parametrize("script", sorted(path.name for path in (ROOT / "scripts").glob("*.py")))
def test_an_interrupt_while_a_script_imports_is_one_line(script):
    command = [sys.executable, "-X", "importtime", str(ROOT / "scripts" / script), "--help"]
    # A shell starts what runs in the background with interrupts ignored, which processes inherit.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    signal.signal(signal.SIGINT, before)
    for line in process.stderr:
        if "tensegrity_agents.interrupt" in line:
            process.send_signal(signal.SIGINT)
            break
    _, errors = process.communicate(timeout=60)
    told = [line for line in errors.splitlines() if not line.startswith("import time:")]
    assert (process.returncode, told) == (130, ["interrupted: nothing was begun yet"])
