"""Controllers, Stable-Baselines3 agents, evaluation and reports for `tensegrity_envs`.

Raises:
    ImportError: the packages of the extra "agents" are not installed.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tensegrity_agents.controllers import make_controller
    from tensegrity_agents.evaluation.rollout import evaluate
    from tensegrity_agents.exporting import export
    from tensegrity_agents.pretrained import load_pretrained
    from tensegrity_agents.sb3.policy_file import load_policy

__all__ = ["evaluate", "export", "load_policy", "load_pretrained", "make_controller"]

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


_FROM = {
    "evaluate": "tensegrity_agents.evaluation.rollout",
    "make_controller": "tensegrity_agents.controllers",
    "export": "tensegrity_agents.exporting",
    "load_pretrained": "tensegrity_agents.pretrained",
    "load_policy": "tensegrity_agents.sb3.policy_file",
}


def __getattr__(name: str) -> Any:
    """What users call, imported when it is asked for: Torch takes seconds."""
    if name in _FROM:
        return getattr(import_module(_FROM[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
