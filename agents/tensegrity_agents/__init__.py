"""Controllers, Stable-Baselines3 agents, evaluation and reports for `tensegrity_envs`.

Raises:
    ImportError: the packages of the extra "agents" are not installed.
"""

from importlib.util import find_spec

_NEEDED = (
    "stable_baselines3",
    "sb3_contrib",
    "torch",
    "safetensors",
    "pydantic",
    "yaml",
    "rich",
    "typer",
    "matplotlib",
    "jinja2",
    "PIL",
)
_missing = [name for name in _NEEDED if find_spec(name) is None]
if _missing:
    raise ImportError(
        f"tensegrity_agents needs {', '.join(_missing)}: install them with  pip install 'tensegrity-envs[agents]'"
    )
