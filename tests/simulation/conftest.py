"""Tests of the MuJoCo models need MuJoCo: without it they are left out, and the summary says so."""

from importlib.util import find_spec

_IS_MISSING = find_spec("mujoco") is None
collect_ignore_glob = ["test_mujoco_*.py"] if _IS_MISSING else []


def pytest_terminal_summary(terminalreporter):
    """Say what was left out."""
    if _IS_MISSING:
        terminalreporter.write_line("left out: tests/simulation/test_mujoco_*.py, since MuJoCo is not installed")
