"""Tests run on a bare machine: windows go to SDL's dummy driver, MuJoCo draws without a display where it can."""

import os
import re

import pytest

from tensegrity_envs.simulation.mujoco.displays import choose_gl

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
choose_gl()


def pytest_addoption(parser):
    """`--full` runs the full tier, too."""
    parser.addoption("--full", action="store_true", help="run the tests of the full tier, too")


def pytest_collection_modifyitems(config, items):
    """Leave out the full tier unless it is asked for; run tests of one environment in one process (`--dist loadgroup`),
    which compiles its code once.
    """
    if not config.getoption("full"):
        later = [item for item in items if item.get_closest_marker("full")]
        config.hook.pytest_deselected(items=later)
        items[:] = [item for item in items if not item.get_closest_marker("full")]
    for item in items:
        named = re.search(r"\btensegrity/(\w+)-v\d", item.nodeid)
        if named:
            item.add_marker(pytest.mark.xdist_group(named[1]))
