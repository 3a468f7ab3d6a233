"""The analytic controllers of the planar 4-bar mechanism in dynamics: at full speed, shaped, along ramps, damped.

All plan lengths; `Damping` then adds small deviations that calm the mechanism. Input shapers are those of Singer and
Seering ("Preshaping Command Inputs to Reduce System Vibration", 1990).
"""

from typing import Any, NamedTuple

import numpy as np

from tensegrity_agents.controllers.dynamic import ADDS, Base, Memory, Pace, Planned
from tensegrity_agents.controllers.fixed_length_damping import Damping, DampingMemory
from tensegrity_agents.controllers.input_shaping import Vibration, shaped
from tensegrity_agents.controllers.planar_four_bar.modes import FourBarModes
from tensegrity_agents.controllers.regulated import FullSpeedPlan
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation


class _Lengths(Planned[Memory]):
    """What the controllers of the 4-bar share.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
        adds: see `dynamic.Adapted`.
        damped: whether deviations calm the mechanism.
    """

    def __init__(self, core: Core, base: Base, adds: str, damped: bool) -> None:
        super().__init__(core, base, f"{adds}{', active damping' if damped else ''}")
        self.modes = FourBarModes(core)
        self.damper = Damping(core, self.modes, damped)


class PathMemory(NamedTuple):
    """What a planned path carries from step to step.

    Attributes:
        plan: lengths after each step, shape (n, steps, inputs) [m].
        step: of the episode, shape (n,).
        damping: see `DampingMemory`.
    """

    plan: np.ndarray
    step: np.ndarray
    damping: DampingMemory


class PlannedPath(_Lengths[PathMemory]):
    """The lengths that a quasi-static controller of the planar 4-bar would give, planned when the episode begins.

    Args:
        core: of the environment.
        base: makes the quasi-static controller, which feeds nothing back.
        pace: at which they are followed: at full speed; the same through two zero-vibration-and-derivative shapers, for
            the modes where the path ends; or along a minimum-jerk time course of 60 steps at least.
        damped: whether deviations calm the mechanism.
    """

    def __init__(self, core: Core, base: Base, pace: Pace = "smooth", damped: bool = True) -> None:
        super().__init__(core, base, ADDS[pace], damped)
        self.pace = pace

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> PathMemory:
        """See `AnalyticController.initial`."""
        plan = self._plan(observed, index)
        if self.pace == "shaped":
            plan = self._shaped(observed, plan)
        return PathMemory(plan, np.zeros(len(index), int), self.damper.begin(observed.inputs))

    def _act(self, observed: DecodedObservation, memory: PathMemory) -> tuple[np.ndarray, PathMemory]:
        plan, step, damping = memory
        wanted = plan[np.arange(len(step)), np.minimum(step, plan.shape[1] - 1)]
        wanted, damping = self.damper.act(observed, observed.inputs, wanted, damping)
        return self.action_to(wanted, observed.inputs), PathMemory(plan, step + 1, damping)

    def _shaped(self, observed: DecodedObservation, plan: np.ndarray) -> np.ndarray:
        """The plan through a shaper for each mode where it ends, without damping; see `input_shaping`."""
        _, _, branch = self.modes.read(observed, plan[:, -1])
        halves = self.damper.half_periods(plan[:, -1], branch)
        return shaped(observed.inputs, plan, Vibration(halves, np.ones_like(halves)))


class SmoothPlan(FullSpeedPlan):
    """The minimum-jerk course of 60 steps at least, and nothing else: agents correct it, and have to damp.

    Args:
        core: of the environment.
        base: makes the quasi-static controller, which feeds nothing back.
    """

    def __init__(self, core: Core, base: Base) -> None:
        super().__init__(core, base)
        self.pace = "smooth"
        self.knows = f"{self.base.knows}; {ADDS[self.pace]}"


class FeedbackMemory(NamedTuple):
    """What a damped feedback carries: the memory of damping (planned lengths included) and of the base controller."""

    damping: DampingMemory
    base: Any


class DampedFeedback(_Lengths[FeedbackMemory]):
    """The pseudo-inverse controller of the planar 4-bar, slowed down not to drive the vibration, and damped.

    Args:
        core: of the environment.
        base: makes the pseudo-inverse controller.
        damped: whether deviations calm the mechanism.
    """

    slowed = 0.15

    def __init__(self, core: Core, base: Base, damped: bool = True) -> None:
        super().__init__(core, base, "slowed down", damped)
        self.base.gain *= self.slowed
        self.base.patience = int(self.base.patience / self.slowed)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> FeedbackMemory:
        """See `AnalyticController.initial`."""
        return FeedbackMemory(self.damper.begin(observed.inputs), self.base.initial(observed, index))

    def _act(self, observed: DecodedObservation, memory: FeedbackMemory) -> tuple[np.ndarray, FeedbackMemory]:
        planned = memory.damping.lengths
        action, base = self.base.act(self.base.decode(self.with_inputs(observed, planned)), memory.base)
        wanted = np.clip(planned + self.rate * action, self.low, self.high)
        commanded, damping = self.damper.act(observed, observed.inputs, wanted, memory.damping)
        return self.action_to(commanded, observed.inputs), FeedbackMemory(damping, base)
