"""Obstacle reach: bring the tip to a target without touching anything."""

from dataclasses import dataclass, field
from typing import ClassVar

from tensegrity_envs.compiler.namespace import Component, Namespace, namespace_of
from tensegrity_envs.simulation.protocol import Episode, State
from tensegrity_envs.tasks.base import share_of
from tensegrity_envs.tasks.reach import InputReach, Reach
from tensegrity_envs.tasks.weights import ObstacleReachWeights


@dataclass(frozen=True, kw_only=True)
class ObstacleReach(Reach):
    """Reaching among obstacles: a further term of the reward, and a cost for methods that keep to constraints.

    Attributes:
        safe: clearance from which on there is no cost [m].
        weights: the weights of the dense reward.
    """

    info_meanings: ClassVar[dict[str, tuple[str, str]]] = {
        "clearance": ("m", "least clearance of the arm from any obstacle during the step; negative on a collision"),
        "cost": ("-", "0 from the safe clearance on, rising to 1 where the arm touches an obstacle"),
    }

    safe: float = 0.02
    weights: ObstacleReachWeights = field(default_factory=ObstacleReachWeights)

    def metrics(self, state: State, episode: Episode) -> dict[str, Component]:
        """Clearance [m] and cost."""
        share = share_of(namespace_of(state.clearance), state.clearance, self.safe)
        return {"clearance": state.clearance, "cost": 1.0 - share}

    def dense_terms(
        self, xp: Namespace, error: Component, state: State, episode: Episode, running: Component, success: Component
    ) -> dict[str, Component]:
        """See `Task.dense_terms` and `ObstacleReachWeights`."""
        terms = super().dense_terms(xp, error, state, episode, running, success)
        return terms | {"clearance": self.weights.clearance * running * share_of(xp, state.clearance, self.safe)}


@dataclass(frozen=True, kw_only=True)
class ObstacleInputReach(ObstacleReach, InputReach):
    """The same where the solutions of an episode are two inputs; see `InputReach`. The potential knows no obstacles."""
