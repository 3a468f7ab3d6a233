"""Track: keep the tip on a goal that moves."""

from dataclasses import dataclass, field
from typing import ClassVar

from tensegrity_envs.compiler.namespace import Component, Namespace
from tensegrity_envs.simulation.protocol import RUNNING, Episode, State
from tensegrity_envs.tasks.base import Task
from tensegrity_envs.tasks.weights import TrackWeights


@dataclass(frozen=True, kw_only=True)
class Track(Task):
    """Success and reward of following a goal that comes round in every cycle.

    What counts is the last cycle: success is having stayed within tolerance all through it. The largest error of it so
    far is carried in the state's record; rewards depend on the present error alone, so they can be relabelled.

    Attributes:
        cycle: steps of a cycle.
        cycles: the number of cycles.
        weights: the weights of the dense reward.
    """

    info_meanings: ClassVar[dict[str, tuple[str, str]]] = {
        "largest_error": ("m", "largest distance from the goal in the last cycle so far"),
    }

    cycle: int
    cycles: int = 2
    weights: TrackWeights = field(default_factory=TrackWeights)

    @property
    def goal_cycle(self) -> int:
        """See `Task.goal_cycle`."""
        return self.cycle

    def check_termination(self, xp: Namespace, error: Component, state: State) -> State:
        """The state with the largest error of the last cycle so far; 0 before it."""
        before = state.record[0] if state.record else 0.0
        counts = state.time >= self.cycle * (self.cycles - 1)
        return state._replace(record=(xp.where(counts, xp.maximum(before, error), 0.0),))

    def is_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether the last cycle is over, and the error was within tolerance all through it."""
        over = state.time >= self.cycle * self.cycles
        return over & (state.record[0] <= self.tolerance) & (state.failure == RUNNING)

    def metrics(self, state: State, episode: Episode) -> dict[str, Component]:
        """The largest error of the last cycle so far [m]."""
        return {"largest_error": state.record[0]}

    def dense_terms(
        self, xp: Namespace, error: Component, state: State, episode: Episode, running: Component, success: Component
    ) -> dict[str, Component]:
        """See `Task.dense_terms` and `TrackWeights`."""
        w = self.weights
        return {
            "distance": w.distance * running / self.remoteness(xp, error),
            "success": w.success * success,
            **self.margin_terms(xp, w, state, running),
        }
