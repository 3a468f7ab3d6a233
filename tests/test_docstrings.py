"""Public functions of the mechanics and the geometry say what they do, and what they raise."""

import ast
import importlib
import inspect
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "envs" / "tensegrity_envs"
ROOMS = ("mechanics", "geometry")
# Those of mechanics/checks.py and design.py that raise where their arguments are wrong.
CHECKS = {"check_finite", "check_count", "check_single", "checked_range", "require", "require_finite_numbers"}
EXPORTING = (
    "tensegrity_envs",
    *(f"tensegrity_envs.{room}" for room in (*ROOMS, "environments", "tasks", "simulation")),
)
EXPORTING += ("tensegrity_agents.controllers", "tensegrity_agents.evaluation", "tensegrity_agents.reporting")


def public_functions(tree):
    """(name, node) of the public functions and methods of a module."""
    for node in tree.body:
        parts = node.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_") else [node]
        for part in parts:
            if isinstance(part, ast.FunctionDef) and not part.name.startswith("_"):
                yield part.name, part


def refuses(function):
    """Whether it raises by itself, or hands its arguments to a check."""
    for node in ast.walk(function):
        if isinstance(node, ast.Raise) and node.exc is not None:
            return True
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in CHECKS:
            return True
    return False


def complaints(source):
    """What is wrong with the docstrings of a module's public functions."""
    for name, function in public_functions(ast.parse(source)):
        told = ast.get_docstring(function) or ""
        if not told.strip().partition("\n")[0].rstrip().endswith((".", ":", ",", ";")) and "\n" not in told.strip():
            yield f"{name}: no sentence"
        if refuses(function) and "Raise" not in told:
            yield f"{name}: it raises, and its docstring has no Raises"


@pytest.mark.parametrize("room", ROOMS)
def test_functions_say_what_they_do_and_raise(room):
    found = [
        f"{path.relative_to(PACKAGE)}: {complaint}"
        for path in sorted((PACKAGE / room).rglob("*.py"))
        for complaint in complaints(path.read_text())
    ]
    assert not found, "\n".join(found)


def test_what_is_wrong_is_found():
    assert len(list(complaints('def f(x):\n    check_finite("x", x, 1)\n'))) == 2
    assert (
        len(list(complaints('class A:\n    def f(self):\n        """Sentence."""\n        raise ValueError("no")\n')))
        == 1
    )
    assert not list(complaints('def f(x):\n    """Sentence.\n\n    Raises:\n        E: x.\n    """\n    raise E\n'))
    assert not list(complaints("def _f(x):\n    raise ValueError\n"))


@pytest.mark.parametrize("module", EXPORTING)
def test_whatever_is_exported_has_a_docstring(module):
    package = importlib.import_module(module)
    for name in getattr(package, "__all__", ()):
        given = getattr(package, name)
        if inspect.isclass(given) or inspect.isfunction(given):
            own = vars(given).get("__doc__") if inspect.isclass(given) else given.__doc__
            assert own and own.strip(), f"{module}.{name}"
