"""Controllers by their names that plan the inputs of an episode at full speed: what agents can correct."""

from collections.abc import Mapping
from typing import Any

from tensegrity_agents.controllers import make_controller
from tensegrity_agents.controllers.regulated import FullSpeed


def full_speed_planner(controller: str, env_id: str, options: Mapping[str, Any] | None) -> FullSpeed[Any]:
    """The controller of that name.

    Args:
        controller: see `controllers.baselines_of`.
        env_id: Gymnasium id.
        options: of the environment.

    Raises:
        ValueError: there is none of this name, or it does not plan the inputs.
    """
    planner = make_controller(controller, env_id, options)
    if not isinstance(planner, FullSpeed):
        raise ValueError(
            f"{controller!r} of {env_id} makes no plan of the inputs at full speed, as closed_form_plan does"
        )
    return planner
