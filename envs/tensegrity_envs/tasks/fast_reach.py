"""Fast reach: bring the tip to a target soon, and keep it there. What counts is the settling time."""

from dataclasses import dataclass
from typing import ClassVar

from tensegrity_envs.compiler.namespace import Component, Namespace
from tensegrity_envs.simulation.protocol import Episode, State
from tensegrity_envs.tasks.reach import Reach


@dataclass(frozen=True, kw_only=True)
class FastReach(Reach):
    """Reaching in which success is to stay on target, and arriving early and ringing does not count.

    The settling time is the time after which the tip has stayed within tolerance; while it is off target, the earliest
    that is still possible, one step from now. It is carried in the state's record. The dense reward depends on the
    present step alone, so it can be relabelled: its success term is earned in every step on target, hence its sum over
    an episode falls with every step before the tip arrives and with every step in which it has rung out again.

    Attributes:
        step_time: duration of a step [s].
        hold: steps for which the tip has to have stayed on target.
    """

    info_meanings: ClassVar[dict[str, tuple[str, str]]] = {
        "settling_time": (
            "s",
            "time after which the tip has stayed on target; while it is off target, the earliest still possible",
        ),
    }

    step_time: float = 0.02
    hold: int = 25

    def check_termination(self, xp: Namespace, error: Component, state: State) -> State:
        """The state with the step since which the tip has been on target; off target, the next one."""
        before = state.record[0] if state.record else 0.0
        return state._replace(record=(xp.where(error <= self.tolerance, before, state.time + 1.0),))

    def is_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether the tip is on target, the arm could rest there, and it has stayed for `hold` steps."""
        return super().is_success(error, state, episode) & (state.time - state.record[0] >= self.hold)

    def earns_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether the tip is on target now, and the arm could rest there."""
        return super().is_success(error, state, episode)

    def metrics(self, state: State, episode: Episode) -> dict[str, Component]:
        """The settling time so far [s]."""
        return {"settling_time": self.step_time * state.record[0]}
