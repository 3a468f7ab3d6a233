"""Posture: reach another configuration without meeting a singularity."""

from dataclasses import dataclass, field

from tensegrity_envs.compiler.namespace import Component, Namespace
from tensegrity_envs.simulation.protocol import Episode, State
from tensegrity_envs.tasks.base import Task
from tensegrity_envs.tasks.weights import PostureWeights


@dataclass(frozen=True, kw_only=True)
class Posture(Task):
    """Reward of changing posture.

    Attributes:
        span: scale of the joint distance [rad].
        margin: scale of the singularity margin: at which the term is full [-].
        weights: the weights of the dense reward.
    """

    span: float
    margin: float
    weights: PostureWeights = field(default_factory=PostureWeights)

    def dense_terms(
        self, xp: Namespace, error: Component, state: State, episode: Episode, running: Component, success: Component
    ) -> dict[str, Component]:
        """See `Task.dense_terms` and `PostureWeights`."""
        w = self.weights
        return {
            "distance": w.distance * running * xp.maximum(1.0 - error / self.span, 0.0),
            "closeness": w.closeness * running / self.remoteness(xp, error),
            "potential": 0.0,  # from a table: filled in by the core
            "clearance": w.clearance * running * xp.minimum(state.stability_margin / self.margin, 1.0),
            "success": w.success * success,
        }
