"""What the controllers of the spatial prism make of an observation."""

from tensegrity_agents.controllers.base import Observation
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation


def decoded(observation: Observation, core: Core) -> DecodedObservation:
    """The decoded observation of n environments, with `next_goal`: where the goal will be after this step, (n, 3) [m].

    Args:
        observation: Dict of arrays of shape (n, ...).
        core: of the environment.
    """
    observed = core.schema.decode(observation)
    return observed.replace(next_goal=observed.tip + observed.goal_in_1)
