"""Controllers, Stable-Baselines3 agents, evaluation and reports for `tensegrity_envs`.

Raises:
    ImportError: the packages of the extra "agents" are not installed.
"""

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tensegrity_agents.pretrained import load_pretrained
    from tensegrity_agents.sb3.policy_file import load_policy

__all__ = ["load_policy", "load_pretrained"]

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


def __getattr__(name: str) -> Any:
    """The loaders of policies, imported when they are asked for: Torch takes seconds."""
    if name == "load_pretrained":
        from tensegrity_agents.pretrained import load_pretrained

        return load_pretrained
    if name == "load_policy":
        from tensegrity_agents.sb3.policy_file import load_policy

        return load_policy
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
