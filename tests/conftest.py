"""Tests run on a bare machine: windows go to SDL's dummy driver, MuJoCo draws without a display where it can."""

import os
import re

import pytest

from tensegrity_envs.simulation.mujoco.displays import choose_gl

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
choose_gl()


def pytest_collection_modifyitems(items):
    """Tests of one environment run in one process, which compiles its code once (`--dist loadgroup`)."""
    for item in items:
        named = re.search(r"\btensegrity/(\w+)-v\d", item.nodeid)
        if named:
            item.add_marker(pytest.mark.xdist_group(named[1]))
