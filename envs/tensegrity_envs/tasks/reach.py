"""Reach: bring the tip to a target and hold it there, staying stable and wrench-feasible.

The reward is a sum of terms, each between 0 and its weight, so that nothing still to come is ever negative: an episode
that ends early because stability or wrench feasibility was lost gives up everything that it could still have collected,
and failing early never pays.
"""

from dataclasses import dataclass, field
from typing import Any

from tensegrity_envs.mechanics.namespace import Component, Components
from tensegrity_envs.simulation.protocol import RUNNING, Episode, State
from tensegrity_envs.tasks.weights import ReachWeights, check_form

_FULL_MARGIN = 0.2


@dataclass(frozen=True)
class Reach:
    """Goal, success and reward of a reaching task.

    Attributes:
        input_scale: scale of the effort [N or m].
        joint_span: scale of the joint distance [rad].
        tolerance: the tip is on target within this distance [m].
        reward_type: "dense", or "sparse" (1 while on target, else 0).
        weights: of the dense reward.
    """

    input_scale: float
    joint_span: float
    tolerance: float = 0.005
    reward_type: str = "dense"
    weights: ReachWeights = field(default_factory=ReachWeights)

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: an unknown reward type, or a tolerance that is not positive.
        """
        check_form(self.reward_type, self.tolerance)

    def is_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether the tip is within tolerance, in a stable and wrench-feasible state."""
        return (error <= self.tolerance) & (state.failure == RUNNING)

    def judge(self, xp: Any, error: Component, state: State) -> State:
        """The state as it is: being away from the target is no failure."""
        return state

    def measures(self, state: State, episode: Episode) -> dict[str, Component]:
        """Nothing besides success and error."""
        return {}

    def effort(self, state: State) -> Component:
        """Mean over the inputs of (input / scale)^2."""
        total: Component = 0.0
        for f in state.inputs:
            total = total + f * f
        return total / (len(state.inputs) * self.input_scale**2)

    def reward_terms(self, xp: Any, error: Component, state: State, episode: Episode) -> dict[str, Component]:
        """The weighted terms of the reward by name; all zero in the step in which the episode fails.

        Args:
            xp: namespace of the components.
            error: distance of the tip from the target [m].
            state: after the step.
            episode: its solutions make the potential; none leaves it out.
        """
        running = xp.where(state.failure == RUNNING, 1.0, 0.0)
        success = xp.where(error <= self.tolerance, running, 0.0)
        if self.reward_type == "sparse":
            return {"success": success}
        w = self.weights
        terms = {"distance": w.distance * running / (1.0 + xp.sqrt(error / self.tolerance))}
        if episode.solutions:
            gap = _nearest(xp, state.configuration, episode.solutions)
            terms["potential"] = w.potential * running * xp.maximum(1.0 - gap / self.joint_span, 0.0)
        stability = xp.minimum(xp.maximum(state.stability_margin / _FULL_MARGIN, 0.0), 1.0)
        wrench = xp.minimum(xp.maximum(state.wrench_margin / _FULL_MARGIN, 0.0), 1.0)
        return terms | {
            "success": w.success * success,
            "effort": w.effort * running * (1.0 - self.effort(state)),
            "stability": w.stability * running * stability,
            "wrench": w.wrench * running * wrench,
        }


def _nearest(xp: Any, q: Components, solutions: tuple[Components, ...]) -> Component:
    """Largest joint difference to the solution where that is smallest [rad]."""
    gap: Component = None
    for solution in solutions:
        to_this: Component = 0.0
        for angle, goal in zip(q, solution, strict=True):
            to_this = xp.maximum(to_this, abs(angle - goal))
        gap = to_this if gap is None else xp.minimum(gap, to_this)
    return gap
