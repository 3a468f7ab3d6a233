"""Posture: reach another configuration without meeting a singularity."""

from dataclasses import dataclass, field
from typing import Any

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.simulation.protocol import RUNNING, Episode, State
from tensegrity_envs.tasks.base import Task
from tensegrity_envs.tasks.weights import PostureWeights


@dataclass(frozen=True, kw_only=True)
class Posture(Task):
    """Reward of changing posture.

    Attributes:
        span: scale of the joint distance [rad].
        margin: scale of the singularity margin: where it counts as far away [-].
        weights: of the dense reward.
    """

    span: float
    margin: float
    weights: PostureWeights = field(default_factory=PostureWeights)

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
