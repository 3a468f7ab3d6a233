"""Imports point one way, and each package works without what it must not need."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ENVS = ROOT / "envs" / "tensegrity_envs"
# Each layer may import itself and those before it.
LAYERS = [
    "compiler",
    "mechanics",
    "geometry",
    "columns",
    "seeding",
    "uncertainty",
    "randomization",
    "rendering",
    "simulation",
    "tasks",
    "observation",
    "options",
    "interface",
    "dynamic_step",
    "batch",
    "relabelling",
    "core",
    "info",
    "environments",
    "arms",
    "episodes",
    "env",
    "mujoco_env",
    "vector_arguments",
    "linear",
    "vector_info",
    "vector_rendering",
    "vector_env",
    "registration",
    "warming",
    "program",
    "__main__",
]
AGENTS = ROOT / "agents" / "tensegrity_agents"
# The same of the agents.
AGENT_LAYERS = [
    "interrupt",
    "yaml_file",
    "whole_file",
    "extras",
    "web_page",
    "own_modules",
    "env_options",
    "controllers",
    "config",
    "evaluation",
    "sb3",
    "reporting",
    "analysis",
    "playground",
    "pretrained",
    "experiment",
    "ablations",
    "campaign",
    "cluster",
    "benchmark",
    "benchmark_against",
    "benchmark_memory",
    "console",
    "command_options",
    "exporting",
    "recording",
    "search",
    "search_on_cluster",
    "command",
]
# Training, evaluation and reports do not know each other, but for the evaluations in the course of a training, and for
# the results that reports are of: `experiment` brings them together.
APART = {"evaluation": {"sb3"}, "reporting": {"sb3"}, "sb3": {"reporting"}, "analysis": {"sb3", "evaluation"}}
FORBIDDEN = {
    "compiler": {"gymnasium", "torch", "pygame", "matplotlib"},
    "mechanics": {"gymnasium", "torch", "pygame", "matplotlib"},
    "geometry": {"gymnasium", "torch", "pygame", "matplotlib"},
    "simulation": {"gymnasium", "torch", "pygame"},
    "tasks": {"gymnasium", "torch", "pygame"},
}


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def layer_of(path):
    return path.relative_to(ENVS).parts[0].removesuffix(".py")


def test_layers_of_the_environments():
    for path in ENVS.rglob("*.py"):
        layer = layer_of(path)
        if layer == "__init__":
            continue
        for name in imports(path):
            parts = name.split(".")
            assert parts[0] not in FORBIDDEN.get(layer, set()), f"{path} imports {name}"
            assert parts[0] != "tensegrity_agents", f"{path} imports {name}"
            if parts[0] == "tensegrity_envs" and len(parts) > 1:
                assert LAYERS.index(parts[1]) <= LAYERS.index(layer), f"{path} imports {name}"


def agent_layer(name):
    """The layer of a module of the agents, by its name without that of the package."""
    found = [layer for layer in AGENT_LAYERS if name == layer or name.startswith(f"{layer}.")]
    assert found, f"tensegrity_agents.{name}: belongs to no layer"
    return max(found, key=len)


def test_layers_of_the_agents():
    for path in AGENTS.rglob("*.py"):
        module = ".".join(path.relative_to(AGENTS).with_suffix("").parts).removesuffix(".__init__")
        if module == "__init__":
            continue
        layer = agent_layer(module)
        for name in imports(path):
            package, _, rest = name.partition(".")
            if package == "tensegrity_agents" and rest:
                other = agent_layer(rest)
                assert AGENT_LAYERS.index(other) <= AGENT_LAYERS.index(layer), f"{path} imports {name}"
                assert other not in APART.get(layer, set()), f"{path} imports {name}"


def imported_modules(path, module, known):
    """Modules of the repository that a file imports, in functions and for type checking only, too.

    A module's own package does not count: whoever imports `a.b` runs `a/__init__.py` first, which may re-export `a.b`.
    """
    for node in ast.walk(ast.parse(path.read_text())):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            submodules = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if name in known else node.module for name in submodules]
        yield from {name for name in names if name in known and name != module}


def circle_in(graph):
    """A circle of a graph {node: successors}, as a list that ends with its first node; None where there is none."""
    done, path = set(), []

    def visit(node):
        if node in path:
            return [*path[path.index(node) :], node]
        if node in done:
            return None
        path.append(node)
        found = next((circle for after in sorted(graph[node]) if (circle := visit(after))), None)
        path.pop()
        done.add(node)
        return found

    return next((circle for node in sorted(graph) if (circle := visit(node))), None)


@pytest.mark.parametrize("package", [ENVS, AGENTS], ids=lambda package: package.name)
def test_no_import_runs_in_a_circle(package):
    files = {
        ".".join(path.relative_to(package.parent).with_suffix("").parts).removesuffix(".__init__"): path
        for path in package.rglob("*.py")
    }
    graph = {module: set(imported_modules(path, module, files)) for module, path in files.items()}
    assert circle_in(graph) is None


def test_a_circle_is_found():
    assert circle_in({"a": {"b"}, "b": {"c", "d"}, "c": set(), "d": {"b"}}) == ["b", "d", "b"]
    assert circle_in({"a": {"b", "c"}, "b": {"c"}, "c": set()}) is None


def test_scripts_only_parse_arguments():
    for path in (ROOT / "scripts").glob("*.py"):
        assert "__main__" in path.read_text(), f"{path}: multiprocess workers import the main script"
        assert not [n for n in imports(path) if n.split(".")[0] in ("stable_baselines3", "torch")], path


def test_environments_load_neither_torch_nor_pygame_nor_sb3():
    code = (
        "import sys, gymnasium, tensegrity_envs; gymnasium.make('tensegrity/TwoXReach-v0').reset(seed=0); "
        "print([m for m in ('torch', 'pygame', 'stable_baselines3', 'matplotlib', 'mujoco') if m in sys.modules])"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip().endswith("[]")


def test_agents_without_their_extra_say_what_to_install():
    code = (
        "import importlib.util as u; f = u.find_spec; "
        "u.find_spec = lambda n, *a: None if n in ('torch', 'stable_baselines3') else f(n, *a); "
        "import tensegrity_agents"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "tensegrity-envs[agents]" in shown.stderr
    assert "torch" in shown.stderr


def test_the_program_without_the_agents_says_what_to_install():
    code = (
        "import importlib.util as u; f = u.find_spec; "
        "u.find_spec = lambda n, *a: None if n in ('torch', 'stable_baselines3') else f(n, *a); "
        "from tensegrity_envs.program import run; run()"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (shown.returncode, shown.stderr.count("\n")) == (1, 1)
    assert "pip install 'tensegrity-envs[agents]'" in shown.stderr
