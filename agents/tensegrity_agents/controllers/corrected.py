"""Controllers by their names that agents can correct: those that plan the inputs, and those with feedback."""

from collections.abc import Mapping
from typing import Any

from tensegrity_agents.controllers import baselines_of, make_controller
from tensegrity_agents.controllers.correctable import Correctable
from tensegrity_agents.controllers.regulated import FullSpeed


def controller_to_correct(
    name: str, env_id: str, options: Mapping[str, Any] | None
) -> FullSpeed[Any] | Correctable[Any]:
    """The controller of that name.

    Args:
        name: see `controllers.baselines_of`.
        env_id: Gymnasium id.
        options: of the environment.

    Raises:
        ValueError: there is none of this name, or it cannot be corrected.
    """
    controller = make_controller(name, env_id, options)
    if isinstance(controller, FullSpeed | Correctable):
        return controller
    others = {other: make_controller(other, env_id, options) for other in baselines_of(env_id, options)}
    can = [other for other, one in others.items() if isinstance(one, FullSpeed | Correctable)]
    raise ValueError(f"{name!r} of {env_id} cannot be corrected; {', '.join(can) or 'no controller of this id'} can")
