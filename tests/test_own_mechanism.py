"""The tutorial of docs/own_mechanism.md: its commands run as written, in a copy of the checkout; it stays small."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "own_mechanism.md"
FOLDER = ROOT / "examples" / "own_mechanism"
COPIED = ("envs", "agents", "configs", "docs", "examples", "scripts", "tests")
FILES = ("pyproject.toml", "constraints.txt", "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "Makefile")
MOST_FILES, MOST_LINES = 6, 400
pytestmark = pytest.mark.xdist_group("own_mechanism")  # one copy of the checkout for all


def commands():
    """The lines of the page's block of commands after `cd`."""
    (block,) = re.findall(r"^```sh\n(.*?)^```$", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    first, *others = block.splitlines()
    assert first == f"cd {FOLDER.relative_to(ROOT)}"
    return others


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Runs a command in the folder of the tutorial in a copy of the checkout, with the packages of the copy."""
    copy = tmp_path_factory.mktemp("checkout")
    left_out = shutil.ignore_patterns("results", "__pycache__", "_build")
    for name in COPIED:
        shutil.copytree(ROOT / name, copy / name, ignore=left_out)
    for name in FILES:
        shutil.copy(ROOT / name, copy / name)
    path = os.pathsep.join(str(copy / name) for name in ("envs", "agents"))

    def at(command):
        program, *arguments = shlex.split(command)
        begin = {"python": [], "tensegrity": ["-c", "from tensegrity_envs.program import run; run()"]}[program]
        return subprocess.run(
            [sys.executable, *begin, *arguments], cwd=copy / FOLDER.relative_to(ROOT),
            env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=False,
        )  # fmt: skip

    return at


def test_the_laws_hold(run):
    laws, *_ = commands()
    done = run(laws)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr
    assert " failed" not in done.stdout


def test_a_baseline_of_ones_own_is_scored(run):
    done = run(commands()[1] + " --episodes 50")
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"closed_form_ik\s+100 ", done.stdout), done.stdout


@pytest.mark.full
def test_an_agent_is_trained_and_compared(run):
    compare = commands()[2]
    done = run(compare)
    assert done.returncode == 0, done.stdout + done.stderr
    success = {name: float(rate) for name, rate in re.findall(r"^ (PPO agent|\w+)\s+([\d.]+) \[", done.stdout, re.M)}
    assert set(success) == {"PPO agent", "closed_form_ik", "pseudo_inverse", "random"}
    assert success["PPO agent"] > success["random"] + 50
    assert "training agent" not in run(f"{compare} --episodes 50").stdout


def test_a_task_of_ones_own_obeys_the_laws(tmp_path):
    """The block of CONTRIBUTING.md, from a working directory outside the repository."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    (block,) = re.findall(r"^```python\n(# my_reach.py\n.*?)^```$", text, re.DOTALL | re.MULTILINE)
    (tmp_path / "my_reach.py").write_text(block)
    (command,) = re.findall(r"^    python (-m pytest tests --ids my_reach:\S+)$", text, re.MULTILINE)
    arguments = command.replace(" tests ", f" {ROOT / 'tests' / 'envs'} ").split()
    done = subprocess.run([sys.executable, *arguments], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr


def test_a_broken_mechanism_breaks_the_laws(run, tmp_path):
    """A wrong sign of the payload's weight in the gradient, in a module of its own."""
    broken = (FOLDER / "mast.py").read_text().replace("load[1] - d.payload", "load[1] + d.payload")
    (tmp_path / "mast.py").write_text(broken)
    shutil.copy(FOLDER / "mast_cases.py", tmp_path)
    laws = [
        sys.executable,
        "-m",
        "pytest",
        str(ROOT / "tests/mechanics/test_mechanism_laws.py"),
        "--cases",
        "mast_cases",
    ]
    done = subprocess.run(laws, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stdout
    assert "test_derivatives_of_the_energy_by_differences" in done.stdout


def test_slips_are_told(run):
    done = run("python -m pytest ../../tests/envs/test_laws.py --ids own/MastReach-v0")
    assert done.returncode == 4
    assert "must be module:id" in done.stderr


def test_every_slip_is_told(run):
    """What pytest shows of the others, without a process for each."""
    slips = {
        ("mast_reach:own/Mast-v7", ""): "registers no 'own/Mast-v7'",
        ("no_such_module:own/A-v0", ""): "no_such_module: cannot be imported",
        ("", "mast"): "no list CASES",
    }
    code = f"""
import sys
from types import SimpleNamespace
import pytest
sys.path.insert(0, "../../tests")
import law_rows
for ids, cases in {list(slips)}:
    given = {{"ids": ids, "cases": cases}}
    try:
        law_rows.take(SimpleNamespace(getoption=given.get))
    except pytest.UsageError as error:
        print(error)
"""
    done = run(shlex.join(["python", "-c", code]))
    told = done.stdout.splitlines()
    assert len(told) == len(slips), done.stderr
    for line, message in zip(told, slips.values(), strict=True):
        assert message in line


def test_it_is_a_few_small_files_outside_the_packages():
    files = [path for path in FOLDER.rglob("*") if path.suffix in (".py", ".yaml")]
    assert 0 < len(files) <= MOST_FILES
    for path in files:
        assert len(path.read_text().splitlines()) <= MOST_LINES, path
    for package in ("envs", "agents"):
        assert not [p for p in (ROOT / package).rglob("*.py") if "MastReach" in p.read_text()]
