"""Code blocks of README and docs run as written; commands name what there is, with options that there are.

Commands that take less than a minute are run, too, with the full tier: pytest tests/test_documentation.py --full
"""

import importlib
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tensegrity_agents.command.program import SUBCOMMANDS, load
from tensegrity_agents.command_options import find_experiment
from tensegrity_agents.config import known_env

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]

PACKAGES = (ROOT / "envs" / "tensegrity_envs", ROOT / "agents" / "tensegrity_agents")
ROOMS = {*(one.name for one in PACKAGES), *(path.stem for one in PACKAGES for path in one.iterdir())} - {"env"}
HOLDING = ("envs", "agents", "scripts", "tests", "examples", "findings", "docs")
FILES = {path.name for folder in HOLDING for ending in ("py", "sh") for path in (ROOT / folder).rglob(f"*.{ending}")}

# Commands of the pages that no test runs as they are: how they begin, and why.
_MENTION = "a mere mention"
LONGER = {
    "make": "what it does is run by the tests of the script that it calls, or is this run",
    "tensegrity watch TwoXReach-v0": "opens a window; with --record it is run",
    "tensegrity play": "opens a window",
    "tensegrity train": "trains for minutes",
    "tensegrity compare": "trains for minutes",
    "tensegrity campaign": "trains for minutes",
    "tensegrity matrix --out results/matrix": "draws what a campaign has measured",
    "tensegrity transfer": "needs trained agents",
    "tensegrity search": "trains for minutes",
    "tensegrity tune": "searches for minutes",
    "tensegrity bench": "measures speeds for minutes",
}


def blocks(language: str) -> list[tuple[str, str]]:
    """Fenced blocks of a language: where they are, and their text."""
    found = []
    for page in PAGES:
        text = page.read_text()
        for match in re.finditer(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
            line = text[: match.start()].count("\n") + 1
            found.append((f"{page.name}:{line}", match.group(1)))
    return found


def commands() -> list[tuple[str, str]]:
    """Command lines, in indented blocks and in the text."""
    found = []
    for page in PAGES:
        for number, line in enumerate(page.read_text().splitlines(), 1):
            inline = [] if line.startswith("    ") else re.findall(r"`([^`]+)`", line)
            whole = [line.strip()] if line.startswith("    ") else []
            for text in (*inline, *whole):
                if re.match(r"make [a-z]|make$|tensegrity (?!COMMAND|--)", text):
                    found.append((f"{page.name}:{number}", text.split("  #")[0].strip()))
    return found


@pytest.mark.parametrize(("place", "code"), blocks("python"), ids=lambda text: text if ".md:" in text else "")
def test_python_blocks_run_as_written(place, code, tmp_path):
    done = subprocess.run(
        [sys.executable, "-W", "error::SyntaxWarning", "-c", code],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, f"{place}\n{done.stderr}"


def test_commands_have_one_spelling():
    """The twins in scripts/ are told of once, in the page of the command."""
    users = [*PAGES, *(ROOT / "docs" / "tutorials").iterdir(), *(ROOT / "configs").iterdir()]
    told = {page.name for page in users if page.is_file() and re.search(r"scripts/\w+\.py", page.read_text())}
    assert told == {"command.md"}


def test_there_are_commands_to_check():
    assert len(commands()) > 30


@pytest.mark.parametrize(("place", "command"), commands(), ids=lambda text: text if ".md:" in text else "")
def test_commands_are_understood(place, command):
    words = shlex.split(command.replace("<id>", "TwoXReach-v0").replace("<name>", "oracle"))
    if words[0] == "make":
        targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
        for word in words[1:]:
            name, _, value = word.partition("=")
            assert name in targets or name == "ENV", place
            if value and value[0].isupper():
                find_experiment(None, value, ROOT / "configs")
        return
    if reason_not_run(command) == _MENTION:
        assert words[1] in SUBCOMMANDS, place
        return
    arguments = [word for word in words[2:] if word not in ("...", "…", "--help")]
    given = load(words[1]).make_context(words[1], arguments).params
    for env_id in [given.get("environment"), *str(given.get("ids") or "all").split(",")]:
        if env_id in (None, "ID", "...", "all") or ":" in env_id or words[1] == "export":  # a module is the reader's
            continue
        if words[1] in ("train", "compare", "search"):
            find_experiment(None, env_id, ROOT / "configs")
        else:
            known_env(env_id)
    if given.get("config"):
        assert (ROOT / given["config"]).is_file() or "results" in str(given["config"]), place


def program_and_arguments(command: str) -> list[str]:
    """The words of a command, with an example for each placeholder."""
    words = shlex.split(command.replace("<id>", "TwoXReach-v0").replace("<name>", "oracle"))
    examples = {"ID": "TwoXReach-v0", "NAME": "oracle"}
    return [examples.get(word, word) for word in words if word not in ("...", "…")]


def reason_not_run(command: str) -> str | None:
    """Why a command is not run as it is; None where it is."""
    text = " ".join(program_and_arguments(command))
    if re.fullmatch(r"tensegrity (?!list)\w+", text):
        return _MENTION
    if "--record" in text.split():
        return None
    return next((why for begins, why in LONGER.items() if f"{text} ".startswith(f"{begins} ")), None)


def runnable() -> list[tuple[str, str]]:
    """The commands that are run, each once."""
    found = {command: place for place, command in reversed(commands()) if reason_not_run(command) is None}
    return sorted((place, command) for command, place in found.items())


def test_every_reason_not_to_run_is_needed():
    texts = [" ".join(program_and_arguments(command)) for _, command in commands()]
    for begins in LONGER:
        assert any(f"{text} ".startswith(f"{begins} ") for text in texts), begins
    assert len(runnable()) > 20


@pytest.fixture(scope="module")
def readers_folder(tmp_path_factory):
    """A folder with the files that the pages let a reader write."""
    folder = tmp_path_factory.mktemp("reader")
    for _, code in blocks("python"):
        if named := re.match(r"# (\w+\.py)\n", code):
            (folder / named[1]).write_text(code)
    (folder / "my_arm.yaml").write_text("b: 0.05\n")
    return folder


@pytest.mark.full
@pytest.mark.parametrize(
    ("place", "command"), runnable(), ids=[f"{place} {command[:60]}" for place, command in runnable()]
)
def test_commands_run(place, command, readers_folder):
    _, *arguments = program_and_arguments(command)
    called = [sys.executable, "-c", "from tensegrity_envs.program import run; run()", *arguments]
    path = os.pathsep.join([str(readers_folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        called, cwd=readers_folder, env=os.environ | {"PYTHONPATH": path},
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, f"{place}: {command}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"


def test_links_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text()):
            assert re.match(r"https?://", target) or (page.parent / target).exists(), f"{page.name}: {target}"


def spans(page: Path) -> list[str]:
    """Code within the text of a page."""
    prose = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    return re.findall(r"`([^`\n]+)`", prose)


def resolves(name: str) -> bool:
    """Whether a dotted name leads to something; names of rooms are looked up in both packages."""
    rooms = ("", "tensegrity_envs.", "tensegrity_agents.")
    for parts in ([*f"{room}{name}".split(".")] for room in rooms):
        for known in range(len(parts), 0, -1):
            try:
                given: Any = importlib.import_module(".".join(parts[:known]))
            except ImportError:
                continue
            for part in parts[known:]:
                given = getattr(given, part, None)
            if given is not None:
                return True
            break
    return False


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_names_of_modules_and_files_lead_somewhere(page):
    for code in spans(page):
        if re.fullmatch(r"[\w/.-]+\.(py|sh)", code) and not code.startswith("my_"):
            assert Path(code).name in FILES, code
        elif code.endswith(".db"):  # of studies, written by the reader
            continue
        elif named := re.fullmatch(rf"((?:{'|'.join(ROOMS)})(?:\.[A-Za-z_]\w*)+)(?:\(.*\))?", code):
            assert resolves(named[1]), code


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_rows_of_tables_have_the_cells_of_their_heads(page):
    """A bar within a cell, in code too, ends the cell unless a backslash is before it; what is over is not shown."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    for rows in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        head, *others = rows.splitlines()
        bars = [len(re.findall(r"(?<!\\)\|", row)) for row in (head, *others)]
        assert len(set(bars)) == 1, others[bars.index(next(b for b in bars if b != bars[0])) - 1]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_lines_can_be_read_in_a_terminal(page):
    """Lines of prose have at most 120 columns; tables, blocks of code and lines of one word (or link) may be longer."""
    prose = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    long = [line for line in prose.splitlines() if len(line) > 120 and not line.startswith(("|", "    ", "`", "<"))]
    assert not long, long
