"""What the laws run over: everything that is ours, or what the command line names instead.

    pytest tests --ids my_module:mine/Id-v0 --cases my_cases

`--ids` takes ids, separated by commas, each with the module that registers it; `--cases` takes modules with a list
`CASES` of `mechanism_cases.Case`. Modules are looked up on the path and in the working directory. `conftest.py` hands
both over before the laws are collected, and leaves out all other tests.
"""

import importlib
import sys
from pathlib import Path

import gymnasium as gym
import pytest

IDS: list[str] = []  # what was asked for
CASES: list = []


def add_options(parser):
    """`--ids` and `--cases`."""
    parser.addoption("--ids", default="", help="environments of your own to run the laws on: module:namespace/Id-v0")
    parser.addoption("--cases", default="", help="modules with a list CASES of mechanisms to run the laws on")


def take(config):
    """Import what the options name.

    Raises:
        pytest.UsageError: a module cannot be imported, registers no such id, or has no CASES.
    """
    here = Path(__file__).parent
    for folder in (str(here / "mechanics"), str(Path.cwd())):
        if folder not in sys.path:
            sys.path.insert(0, folder)
    for name in filter(None, config.getoption("ids").split(",")):
        module, colon, env_id = name.partition(":")
        if not colon:
            raise pytest.UsageError(f"--ids {name}: must be module:id, such as my_module:mine/Id-v0")
        _module(module, "--ids")
        if env_id not in gym.registry:
            raise pytest.UsageError(f"--ids {name}: {module} registers no {env_id!r}")
        IDS.append(env_id)
    for name in filter(None, config.getoption("cases").split(",")):
        module = _module(name, "--cases")
        if not getattr(module, "CASES", None):
            raise pytest.UsageError(f"--cases {name}: there is no list CASES of mechanism_cases.Case in it")
        CASES.extend(module.CASES)


def has_no_law(path):
    """Whether laws were asked for, and a file of tests has none."""
    return bool(IDS or CASES) and path.suffix == ".py" and "law_rows" not in path.read_text()


def select(config, items):
    """Leave only the laws of what was asked for, if anything was."""
    if not (IDS or CASES):
        return

    def is_asked_for(item):
        given = getattr(item, "callspec", None)
        values = given.params if given else {}
        return values.get("env_id") in IDS or any(values.get("case") is case for case in CASES)

    config.hook.pytest_deselected(items=[item for item in items if not is_asked_for(item)])
    items[:] = [item for item in items if is_asked_for(item)]


def _module(name, option):
    try:
        return importlib.import_module(name)
    except Exception as error:
        raise pytest.UsageError(f"{option} {name}: cannot be imported ({type(error).__name__}: {error})") from error


def ids(ours):
    """The ids that were asked for, or ours."""
    return IDS or list(ours)


def cases(ours):
    """The mechanisms that were asked for, or ours."""
    return CASES or list(ours)


def controllers(ours):
    """Pairs (id, name) of the baselines of the ids that were asked for, or ours; of the random one, none."""
    from tensegrity_agents.controllers import baselines_of  # laws of environments run without agents

    return [(env_id, name) for env_id in ids(ours) for name in baselines_of(env_id) if name != "random"]
