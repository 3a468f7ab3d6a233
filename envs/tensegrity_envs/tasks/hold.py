"""Hold: keep the tip on a target while an unseen force grows, for as long as it can be done."""

from dataclasses import dataclass, field
from typing import ClassVar

from tensegrity_envs.compiler.namespace import Component, Namespace, namespace_of
from tensegrity_envs.simulation.protocol import OFF_TARGET, RUNNING, Episode, State
from tensegrity_envs.tasks.base import Task, share_of
from tensegrity_envs.tasks.weights import HoldWeights

_FULL_MARGIN = 0.1


@dataclass(frozen=True, kw_only=True)
class Hold(Task):
    """Score and reward of holding against a growing force; beyond the tolerance the episode ends.

    In the sparse form a step is worth 1 while a force of at least the reference is held.

    Attributes:
        reference_load: the force that counts as 1 [N].
        weights: the weights of the dense reward.
    """

    goals_decide = False
    has_score = True
    info_meanings: ClassVar[dict[str, tuple[str, str]]] = {
        "score": ("-", "largest force held so far, divided by the reference"),
    }

    reference_load: float
    weights: HoldWeights = field(default_factory=HoldWeights)

    def score(self, state: State, episode: Episode) -> Component:
        """The largest force held so far, divided by the reference.

        In the step in which the episode fails, the force before it.
        """
        xp = namespace_of(*state.tip, state.time)
        held = xp.where(state.failure == RUNNING, state.time, xp.maximum(state.time - 1, 0.0))
        fx, fy = episode.load_at(held)
        return xp.hypot(fx, fy) / self.reference_load

    def is_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether a force of at least the reference has been held."""
        return self.score(state, episode) >= 1

    def check_termination(self, xp: Namespace, error: Component, state: State) -> State:
        """A tip off target is a failure ("off target"), unless the arm has failed otherwise."""
        physical = xp.where(state.failure == OFF_TARGET, RUNNING, state.failure)
        off = (error > self.tolerance) & (physical == RUNNING)
        return state._replace(failure=xp.where(off, OFF_TARGET, physical))

    def metrics(self, state: State, episode: Episode) -> dict[str, Component]:
        """The score so far."""
        return {"score": self.score(state, episode)}

    def earns_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether a force of at least the reference has been held."""
        return self.is_success(error, state, episode)

    def dense_terms(
        self, xp: Namespace, error: Component, state: State, episode: Episode, running: Component, success: Component
    ) -> dict[str, Component]:
        """See `Task.dense_terms` and `HoldWeights`."""
        w = self.weights
        return {
            "hold": w.hold * running,
            "distance": w.distance * running * xp.maximum(1.0 - error / self.tolerance, 0.0),
            "stability": w.stability * running * share_of(xp, state.stability_margin, _FULL_MARGIN),
            "success": w.success * success,
        }
