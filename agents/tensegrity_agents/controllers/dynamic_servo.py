"""A ramp for an arm that is not quite the nominal one, behind a delay, seen through noise.

As `dynamic.Ramp`, but the plan is tracked by the controller's own command u, u <- clip(u + rate * action), not by the
measured inputs, so that a delay only moves the same inputs to later steps. When the command has rested at the end of
the plan for `wait` steps, in which delay and vibration die away, and `mean` steps more, and the mean tip of the latter
is farther from the target than `enough` tolerances, the quasi-static controller plans anew from there: an observer then
identifies the load from that mean and the command.
"""

from typing import ClassVar, NamedTuple

import numpy as np

from tensegrity_agents.controllers.dynamic import Base, Planned
from tensegrity_agents.controllers.resting import first_tips, planned_at, with_latest
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation


class ServoMemory(NamedTuple):
    """What is carried from step to step, for n environments.

    Attributes:
        plan: inputs after each step, (n, steps, inputs).
        step: of the plan, (n,).
        end: step from which on it rests, (n,).
        inputs: the command u, (n, inputs).
        tips: the latest tips, the newest first, (n, 16, 2) [m].
    """

    plan: np.ndarray
    step: np.ndarray
    end: np.ndarray
    inputs: np.ndarray
    tips: np.ndarray


class RestingRamp(Planned[ServoMemory]):
    """A smooth ramp along its own command, planned anew from the mean tip at rest. See the module.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
    """

    wait = 5  # steps
    mean = 16  # tips, at most 16
    enough = 0.3
    shortest_again = 25  # steps of a plan that is made again: a short way
    tunable: ClassVar[dict[str, tuple[float, ...]]] = {
        "wait": (5, 15),
        "mean": (12, 16),
        "enough": (0.3, 0.4),
        "shortest_again": (15, 25),
        "damping": (2.0, 5.0),
    }

    def __init__(self, core: Core, base: Base) -> None:
        super().__init__(
            core, base, "smooth ramp along its own command, active damping; again from the mean tip at rest"
        )

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> ServoMemory:
        """See `AnalyticController.initial`."""
        plan = self._plan(observed, index)
        return ServoMemory(plan, np.zeros(len(index), int), self._ends(plan), observed.inputs, first_tips(observed.tip))

    def _act(self, observed: DecodedObservation, memory: ServoMemory) -> tuple[np.ndarray, ServoMemory]:
        memory = memory._replace(tips=with_latest(memory.tips, observed.tip))
        error = np.hypot(*(observed.target - memory.tips[:, : self.mean].mean(axis=1)).T)
        rests = memory.step >= memory.end + self.wait + self.mean
        again = np.flatnonzero(rests & (error > self.enough * self.core.task.tolerance))
        if len(again):
            memory = self._planned_anew(observed, memory, again)
        wanted = planned_at(memory.plan, memory.step)
        own = observed.replace(inputs=memory.inputs)
        action = np.clip(self.damped(own, wanted, self.believed(own, wanted)), -1.0, 1.0)
        inputs = np.clip(memory.inputs + self.rate * action, self.low, self.high)
        return action, memory._replace(step=memory.step + 1, inputs=inputs)

    def _planned_anew(self, observed: DecodedObservation, memory: ServoMemory, index: np.ndarray) -> ServoMemory:
        """The memory with new plans for the environments at `index`, where there are any."""
        tip = memory.tips[index, : self.mean].mean(axis=1)
        new = self._plan(observed.take(index).replace(tip=tip, inputs=memory.inputs[index]), index, self.shortest_again)
        fine = np.isfinite(new).all(axis=(1, 2))
        index, new = index[fine], new[fine]
        plan, step, end = memory.plan.copy(), memory.step.copy(), memory.end.copy()
        plan[index], step[index], end[index] = new, 0, self._ends(new)
        return memory._replace(plan=plan, step=step, end=end)


class OwnRamp(RestingRamp):
    """The same, planned once: for one who has nothing to identify."""

    enough = np.inf
