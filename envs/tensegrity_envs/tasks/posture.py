"""Posture: reach another configuration without meeting a singularity."""

from dataclasses import dataclass, field
from typing import Any

from tensegrity_envs.mechanics.namespace import Component
from tensegrity_envs.simulation.protocol import RUNNING, Episode, State
from tensegrity_envs.tasks.weights import PostureWeights, check_form


@dataclass(frozen=True)
class Posture:
    """Success and reward of changing posture.

    Attributes:
        span: scale of the joint distance [rad].
        margin: scale of the singularity margin: where it counts as far away [-].
        tolerance: the goal is reached within this distance, in each angle [rad].
        reward_type: "dense", or "sparse" (1 while at the goal, else 0).
        weights: of the dense reward.
    """

    span: float
    margin: float
    tolerance: float = 0.02
    reward_type: str = "dense"
    weights: PostureWeights = field(default_factory=PostureWeights)

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: an unknown reward type, or a tolerance that is not positive.
        """
        check_form(self.reward_type, self.tolerance)

    def is_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether the configuration is within tolerance of the goal."""
        return (error <= self.tolerance) & (state.failure == RUNNING)

    def judge(self, xp: Any, error: Component, state: State) -> State:
        """The state as it is."""
        return state

    def measures(self, state: State, episode: Episode) -> dict[str, Component]:
        """Nothing besides success and error."""
        return {}

    def effort(self, state: State) -> Component:
        """None: there are no inputs."""
        return 0.0

    def reward_terms(self, xp: Any, error: Component, state: State, episode: Episode) -> dict[str, Component]:
        """The weighted terms of the reward by name; all zero in the step in which the episode fails."""
        running = xp.where(state.failure == RUNNING, 1.0, 0.0)
        success = xp.where(error <= self.tolerance, running, 0.0)
        if self.reward_type == "sparse":
            return {"success": success}
        w = self.weights
        return {
            "distance": w.distance * running * xp.maximum(1.0 - error / self.span, 0.0),
            "closeness": w.closeness * running / (1.0 + xp.sqrt(error / self.tolerance)),
            "potential": 0.0,  # from a table: filled in by the core
            "clearance": w.clearance * running * xp.minimum(state.stability_margin / self.margin, 1.0),
            "success": w.success * success,
        }
