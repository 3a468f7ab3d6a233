"""The analytic controllers of the spatial prism in dynamics: at full speed or shaped, damped or not.

All plan lengths; `Damping` then adds small deviations that calm the platform.
"""

from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.correctable import Correctable
from tensegrity_agents.controllers.dynamic import ADDS, Adapted, Base, Pace
from tensegrity_agents.controllers.fixed_length_damping import Damping, DampingMemory
from tensegrity_agents.controllers.spatial_prism.modes import PrismModes
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation

_FAR = 3.0  # steps of the rate that are shown as 1


class Memory(NamedTuple):
    """What a controller carries from step to step.

    Attributes:
        step: of the episode, shape (n,).
        damping: see `DampingMemory`.
    """

    step: np.ndarray
    damping: DampingMemory


class CurveTracking(Adapted[Memory]):
    """A quasi-static controller of the spatial prism that follows the curve, shaped or not, damped or not.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
        pace: "full", or "shaped": a quarter each of the goals now and in two steps, half of the one in a step. The
            curve is known ahead, so that shaping does not delay.
        damped: whether deviations calm the platform.
        adds: see `dynamic.Adapted`; by default the pace.
    """

    def __init__(
        self, core: Core, base: Base, pace: Pace = "full", damped: bool = True, adds: str | None = None
    ) -> None:
        super().__init__(core, base, f"{adds or ADDS[pace]}{', active damping' if damped else ''}")
        self.pace = pace
        self.damper = Damping(core, PrismModes(core), damped)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> Memory:
        """See `AnalyticController.initial`."""
        return Memory(np.zeros(len(index), int), self.damper.begin(observed.lengths))

    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        planned = self.planned(observed, memory)
        commanded, damping = self.damper.act(observed, observed.lengths, planned, memory.damping)
        return self.action_to(commanded, observed.lengths), Memory(memory.step + 1, damping)

    def planned(self, observed: DecodedObservation, memory: Memory) -> np.ndarray:
        """Lengths after this step, shape (n, 3) [m]."""
        if self.pace == "full":
            return np.asarray(self.base.lengths(observed, memory.step))
        later = observed.tip + observed.goal_in_2
        goals = ((0.25, observed.target), (0.5, observed.next_goal), (0.25, later))
        lengths = [weight * self.base.lengths(observed.replace(next_goal=goal), memory.step) for weight, goal in goals]
        return np.asarray(sum(lengths))


class CurvePlan(CurveTracking, Correctable[Memory]):
    """The curve at full speed without damping, which an agent can correct: it starts from the measured lengths, always.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
    """

    def __init__(self, core: Core, base: Base) -> None:
        super().__init__(core, base, damped=False)

    def given(self, before: Memory, after: Memory, action: np.ndarray) -> Memory:
        """See `Correctable.given`: nothing of it is remembered."""
        return after

    @property
    def outlook_size(self) -> int:
        """See `Correctable.outlook_size`."""
        return int(self.core.simulation.action_size)

    def outlook(self, observed: DecodedObservation, memory: Memory) -> np.ndarray:
        """See `Correctable.outlook`: the way to the lengths of the goal in two steps."""
        later = observed.replace(next_goal=observed.tip + observed.goal_in_2)
        return np.asarray((self.base.lengths(later, memory.step) - observed.lengths) / (_FAR * self.rate))


class TrackingFeedback(CurveTracking):
    """Resolved rate: the goal's own step, and a share of the distance from the measured position to the goal.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
        damped: whether deviations calm the platform.
    """

    slowed = 0.15

    def __init__(self, core: Core, base: Base, damped: bool = True) -> None:
        super().__init__(core, base, "full", damped, "slowed down")

    def planned(self, observed: DecodedObservation, memory: Memory) -> np.ndarray:
        """See `CurveTracking.planned`."""
        wanted = observed.next_goal - observed.target + self.slowed * (observed.target - observed.tip)
        imagined = observed.replace(lengths=memory.damping.lengths, next_goal=observed.tip + wanted)
        return np.asarray(self.base.lengths(imagined, memory.step))
