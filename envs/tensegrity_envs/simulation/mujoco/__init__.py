"""The mechanisms as dynamic simulations in MuJoCo, built from the nodes and members of the analytic models.

MuJoCo is an extra: importing this module does not need it, `MujocoModel` does.
"""

from typing import TYPE_CHECKING, Any

from tensegrity_envs.simulation.mujoco.displays import choose_gl
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics

if TYPE_CHECKING:
    from tensegrity_envs.simulation.mujoco.engine import Engine
    from tensegrity_envs.simulation.mujoco.model import MujocoModel, Relaxed, RolloutResult

__all__ = ["Dynamics", "Engine", "MujocoModel", "Relaxed", "RolloutResult"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    choose_gl()
    try:
        from tensegrity_envs.simulation.mujoco import engine, model
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        raise ImportError(
            'the dynamic simulations need MuJoCo 4 or later: pip install "tensegrity-envs[mujoco]"', name="mujoco"
        ) from error
    return engine.Engine if name == "Engine" else getattr(model, name)
