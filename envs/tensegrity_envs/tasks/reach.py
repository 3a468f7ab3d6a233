"""Reach: bring the tip to a target and hold it there, staying stable and wrench-feasible."""

from dataclasses import dataclass, field

from tensegrity_envs.compiler.namespace import Component, Components, Namespace
from tensegrity_envs.geometry.obstacle_path import Disc, shortest_path
from tensegrity_envs.simulation.protocol import Episode, State
from tensegrity_envs.tasks.base import Task
from tensegrity_envs.tasks.weights import ReachWeights


@dataclass(frozen=True, kw_only=True)
class Reach(Task):
    """Reward of a reaching task.

    Attributes:
        joint_span: scale of the distance from a solution, in the unit of the configuration.
        weights: the weights of the dense reward.
    """

    joint_span: float
    weights: ReachWeights = field(default_factory=ReachWeights)

    def is_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether the tip is within tolerance and the arm could rest there: a moving arm may be where it could not."""
        return super().is_success(error, state, episode) & (state.stability_margin > 0)

    def distance_to(self, xp: Namespace, state: State, solution: Components) -> Component:
        """The distance of a state from a solution: the largest difference of a coordinate of the configuration."""
        largest: Component = 0.0
        for angle, goal in zip(state.configuration, solution, strict=True):
            largest = xp.maximum(largest, abs(angle - goal))
        return largest

    def earns_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether the task is done, as things are."""
        return self.is_success(error, state, episode)

    def dense_terms(
        self, xp: Namespace, error: Component, state: State, episode: Episode, running: Component, success: Component
    ) -> dict[str, Component]:
        """See `Task.dense_terms` and `ReachWeights`; without solutions of the episode there is no potential."""
        w = self.weights
        terms = {"distance": w.distance * running / self.remoteness(xp, error)}
        if episode.solutions:
            nearest: Component = None
            for solution in episode.solutions:
                distance = self.distance_to(xp, state, solution)
                nearest = distance if nearest is None else xp.minimum(nearest, distance)
            terms["potential"] = w.potential * running * xp.maximum(1.0 - nearest / self.joint_span, 0.0)
        return terms | {
            "success": w.success * success,
            "effort": w.effort * running * (1.0 - self.effort(state)),
            **self.margin_terms(xp, w, state, running),
        }


@dataclass(frozen=True, kw_only=True)
class InputReach(Reach):
    """Reaching where the solutions of an episode are two inputs, and `joint_span` is a scale of inputs.

    Attributes:
        obstacle: the disc in the plane of the inputs round which the path to a solution leads.
    """

    obstacle: Disc

    def distance_to(self, xp: Namespace, state: State, solution: Components) -> Component:
        """The length of the shortest path of the inputs."""
        return shortest_path(state.inputs, solution, self.obstacle)[0]
