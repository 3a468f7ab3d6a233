"""Controllers by their names that agents can correct: those that plan the inputs, and those with feedback."""

from collections.abc import Mapping
from typing import Any

from tensegrity_agents.controllers import baselines_of, make_controller
from tensegrity_agents.controllers.correctable import Correctable
from tensegrity_agents.controllers.regulated import FullSpeedPlan


def controller_to_correct(
    name: str, env_id: str, options: Mapping[str, Any] | None
) -> FullSpeedPlan | Correctable[Any]:
    """The controller of that name.

    Args:
        name: see `controllers.baselines_of`.
        env_id: Gymnasium id.
        options: of the environment.

    Raises:
        ValueError: there is none of this name, or it cannot be corrected.
    """
    makers = baselines_of(env_id, options)
    # No code that a policy's file names is run: only controllers of the package.
    if name in makers:
        found: FullSpeedPlan | Correctable[Any] = make_controller(name, env_id, options)
        if _can_be(found):
            return found
    can = [other for other in makers if _can_be(make_controller(other, env_id, options))]
    raise ValueError(f"{name!r} of {env_id} cannot be corrected; {', '.join(can) or 'no controller of this id'} can")


def _can_be(controller: Any) -> bool:
    """Whether an agent can correct it: it plans and does nothing else, or goes on from what was done."""
    is_kind = isinstance(controller, FullSpeedPlan | Correctable)
    return is_kind and not getattr(controller, "wants_privileged", False)
