"""Reach: bring the tip to a target and hold it there, staying stable and wrench-feasible.

The reward is a sum of terms, each between 0 and its weight, so that nothing still to come is ever negative: an episode
that ends early because stability or wrench feasibility was lost gives up everything that it could still have collected,
and failing early never pays.
"""

from dataclasses import dataclass, field
from typing import Any

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.detour import Disc, shortest_way
from tensegrity_envs.simulation.protocol import RUNNING, Episode, State
from tensegrity_envs.tasks.base import Task
from tensegrity_envs.tasks.weights import ReachWeights

_FULL_MARGIN = 0.2


@dataclass(frozen=True, kw_only=True)
class Reach(Task):
    """Reward of a reaching task.

    Attributes:
        joint_span: scale of the distance from a solution.
        weights: of the dense reward.
    """

    joint_span: float
    weights: ReachWeights = field(default_factory=ReachWeights)

    def is_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether the tip is within tolerance and the arm could rest there: a moving arm may be where it could not."""
        return super().is_success(error, state, episode) & (state.stability_margin > 0)

    def away(self, xp: Any, state: State, solution: Components) -> Component:
        """How far a state is from a solution: the largest joint difference [rad]."""
        largest: Component = 0.0
        for angle, goal in zip(state.configuration, solution, strict=True):
            largest = xp.maximum(largest, abs(angle - goal))
        return largest

    def reward_terms(self, xp: Any, error: Component, state: State, episode: Episode) -> dict[str, Component]:
        """The weighted terms of the reward by name; all zero in the step in which the episode fails.

        Args:
            xp: namespace of the components.
            error: distance of the tip from the target [m].
            state: after the step.
            episode: its solutions make the potential; none leaves it out.
        """
        running = xp.where(state.failure == RUNNING, 1.0, 0.0)
        success = xp.where(self.is_success(error, state, episode), running, 0.0)
        if self.reward_type == "sparse":
            return {"success": success}
        w = self.weights
        terms = {"distance": w.distance * running / (1.0 + xp.sqrt(error / self.tolerance))}
        if episode.solutions:
            gap: Component = None
            for solution in episode.solutions:
                away = self.away(xp, state, solution)
                gap = away if gap is None else xp.minimum(gap, away)
            terms["potential"] = w.potential * running * xp.maximum(1.0 - gap / self.joint_span, 0.0)
        stability = xp.minimum(xp.maximum(state.stability_margin / _FULL_MARGIN, 0.0), 1.0)
        wrench = xp.minimum(xp.maximum(state.wrench_margin / _FULL_MARGIN, 0.0), 1.0)
        return terms | {
            "success": w.success * success,
            "effort": w.effort * running * (1.0 - self.effort(state)),
            "stability": w.stability * running * stability,
            "wrench": w.wrench * running * wrench,
        }


@dataclass(frozen=True, kw_only=True)
class InputReach(Reach):
    """Reaching where the solutions of an episode are two inputs, and `joint_span` is a scale of inputs.

    Attributes:
        obstacle: in the plane of the inputs, which the way to a solution leads round.
    """

    obstacle: Disc

    def away(self, xp: Any, state: State, solution: Components) -> Component:
        """The length of the shortest way of the inputs."""
        return shortest_way(state.inputs, solution, self.obstacle)[0]
