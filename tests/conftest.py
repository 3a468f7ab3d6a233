"""Tests run on a bare machine: windows go to SDL's dummy driver, MuJoCo draws without a display where it can."""

import json
import os
import re
import shutil
import subprocess

import pytest

import law_rows
from tensegrity_envs.simulation.mujoco.displays import choose_gl

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("OMP_NUM_THREADS", "1")  # of each process that the tests start: pytest-xdist uses the cores
choose_gl()
# Files of the longest tests, which start first: no process is left with one of them while the others have ended.
LONG = {"test_analyze", "test_campaign", "test_own_mechanism", "test_side_by_side", "test_site"}


def pytest_addoption(parser):
    """`--full` runs the full tier, too; `--ids` and `--cases` run the laws on what is your own."""
    parser.addoption("--full", action="store_true", help="run the tests of the full tier, too")
    law_rows.add_options(parser)


def pytest_configure(config):
    """Take what `--ids` and `--cases` name."""
    law_rows.take(config)


def pytest_ignore_collect(collection_path):
    """Import no file without a law where `--ids` or `--cases` ask for laws alone."""
    return law_rows.has_no_law(collection_path) or None


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist looks at the groups
def pytest_collection_modifyitems(config, items):
    """Leave out the full tier unless it is asked for; run tests of one environment in one process (`--dist loadgroup`),
    which compiles its code once.
    """
    if not config.getoption("full"):
        later = [item for item in items if item.get_closest_marker("full")]
        config.hook.pytest_deselected(items=later)
        items[:] = [item for item in items if not item.get_closest_marker("full")]
    law_rows.select(config, items)
    items.sort(key=lambda item: item.path.stem not in LONG)
    for item in items:
        named = re.search(r"\btensegrity/(\w+)-v\d", item.nodeid)
        if named:
            item.add_marker(pytest.mark.xdist_group(named[1]))


@pytest.fixture
def in_browser(tmp_path):
    """A function that shows a page in headless Chromium, runs a script there and gives the value that it returns."""
    found = next(
        (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
    )
    if found is None:
        pytest.skip("no chromium: apt-get install chromium")

    def run(html, script, size=(1300, 1000)):
        page = tmp_path / "in_browser.html"
        write = "document.body.replaceChildren(); document.body.textContent = '<' + JSON.stringify(answer) + '>'"
        code = (
            f"try {{ answer = (() => {{ {script} }})(); }} catch (error) {{ answer = {{error: String(error.stack)}}; }}"
        )
        page.write_text(html.replace("</body>", f"<script>{{ let answer; {code} {write}; }}</script></body>"))
        command = [found, "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=20000"]
        command += [f"--user-data-dir={tmp_path}/profile", f"--window-size={size[0]},{size[1]}", "--dump-dom"]
        done = subprocess.run([*command, f"file://{page}"], capture_output=True, text=True, check=True, timeout=120)
        matches = re.findall(r"&lt;(.*)&gt;\s*</body>", done.stdout, re.DOTALL)
        assert matches, done.stdout[-2000:] + done.stderr[-2000:]
        (answer,) = matches
        for sign, text in (("<", "&lt;"), (">", "&gt;"), ("&", "&amp;")):
            answer = answer.replace(text, sign)
        value = json.loads(answer)
        assert not (isinstance(value, dict) and "error" in value), value["error"]
        return value

    return run
