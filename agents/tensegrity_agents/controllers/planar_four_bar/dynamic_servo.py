"""The planar 4-bar mechanism in dynamics, not quite the nominal one, behind a delay, seen through noise.

Without a load its rest depends on the lengths alone: no stiffness, mass or damping moves it. So the inverse kinematics
are exact, and all that is to be done is not to set the mechanism swinging: the lengths follow a minimum-jerk course of
at least `shortest` steps, by the controller's own command u, u <- clip(u + rate a), which a delay only moves to later
steps. An integral of the error would add noise, and has nothing to remove.

Deviations that calm the mechanism (`fixed_length_damping`) are given where there is no delay. Behind one they come too
late and drive the vibration, of which a period is ten steps or so.
"""

from typing import ClassVar, NamedTuple

import numpy as np

from tensegrity_agents.controllers.delay_line import delays_of
from tensegrity_agents.controllers.dynamic import Base, Planned
from tensegrity_agents.controllers.fixed_length_damping import Damping, DampingMemory
from tensegrity_agents.controllers.planar_four_bar.modes import FourBarModes
from tensegrity_agents.controllers.planar_four_bar.reach import ClosedFormIK
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation


class OwnPathMemory(NamedTuple):
    """What is carried from step to step, for n environments.

    Attributes:
        plan: lengths after each step, (n, steps, 2) [m].
        step: of the episode, (n,).
        inputs: the command u, (n, 2) [m].
        damping: see `DampingMemory`.
    """

    plan: np.ndarray
    step: np.ndarray
    inputs: np.ndarray
    damping: DampingMemory


class OwnPath(Planned[OwnPathMemory]):
    """A smooth ramp along its own command, damped where there is no delay. See the module.

    Args:
        core: of the environment.
        base: makes the quasi-static controller, which feeds nothing back.
    """

    is_told_ranges = True
    shortest = 80
    tunable: ClassVar[dict[str, tuple[float, ...]]] = {"shortest": (60, 80, 100)}

    def __init__(self, core: Core, base: Base) -> None:
        is_late = delays_of(core)[1] > 0
        how = "no damping behind a delay" if is_late else "active damping"
        super().__init__(core, base, f"smooth ramp along its own command, {how}")
        self.damper = Damping(core, FourBarModes(core), not is_late)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> OwnPathMemory:
        """See `AnalyticController.initial`."""
        plan, damping = self._plan(observed, index), self.damper.begin(observed.inputs)
        return OwnPathMemory(plan, np.zeros(len(index), int), observed.inputs, damping)

    def _act(self, observed: DecodedObservation, memory: OwnPathMemory) -> tuple[np.ndarray, OwnPathMemory]:
        last = memory.plan.shape[1] - 1
        planned = memory.plan[np.arange(len(memory.step)), np.minimum(memory.step, last)]
        wanted, damping = self.damper.act(observed, memory.inputs, planned, memory.damping)
        action = np.clip(self.action_to(wanted, memory.inputs), -1.0, 1.0)
        inputs = np.clip(memory.inputs + self.rate * action, self.low, self.high)
        return action, memory._replace(step=memory.step + 1, inputs=inputs, damping=damping)


class Told(ClosedFormIK):
    """The same plan for one who is told everything: nothing of it would change the lengths."""

    wants_privileged = True
    knows = "everything that was drawn, none of which moves the mechanism at rest; closed-form inverse kinematics"
