"""Controllers of the dual-triangle arm that is not quite the nominal one, behind a delay, seen through noise.

Both plan as a nominal controller does and track their own command u, not the measured inputs, so that a delay only
moves the same inputs to later steps. When the command has rested at the end of the plan for `wait` steps, longer than
the delay, and `mean` steps more, they look again, at the mean of the tips of the latter, which averages the noise; if
the error is more than `enough` tolerances they plan anew from their command.

The servo moves its target: with the error e = target - mean tip that is left,

    target' <- target' + e  (of at most `largest`),

an integral in steps. The identifying observer solves configuration and load anew from mean tip and command
(`identification.explain`: the stable stationary points of the springs' energy along the tip's self-motion curve) and
plans with these. At first it holds the inputs for `looks` steps, so that no plan rests on a single measurement. A wrong
stiffness is then told as a load that has the same effect where the arm is, and nearly the same where it goes.
"""

from typing import ClassVar, NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import rows_of, with_rows
from tensegrity_agents.controllers.correctable import Correctable
from tensegrity_agents.controllers.dual_triangle.reach import ClosedFormSquares, Memory, Observer, ReachController
from tensegrity_agents.controllers.resting import LATEST, ends_of_plans, first_tips, with_latest
from tensegrity_envs.core import Core
from tensegrity_envs.mechanics.dual_triangle import DualTriangleDesign
from tensegrity_envs.observation import DecodedObservation

_STILL = 1e-9  # [m]
_FAR, _SOON = 10.0, 20.0  # steps of the rate to the end of the plan, and of time, that are shown as 1
_NEAR = 5.0  # tolerances that are


class ServoMemory(NamedTuple):
    """What is carried from step to step, for n environments.

    Attributes:
        plan: of the controller that plans.
        inputs: the command u, (n, 3) [m].
        tips: the latest tips, the newest first, (n, 16, 2) [m].
        shift: of the target, (n, 2) [m].
        end: step of the plan from which on the command rests, (n,).
        looks: whether the inputs are held for the first plan, (n,).
        added: what an agent has added to the command since it was planned, (n, 3) [m].
    """

    plan: Memory
    inputs: np.ndarray
    tips: np.ndarray
    shift: np.ndarray
    end: np.ndarray
    looks: np.ndarray
    added: np.ndarray


class Servo(Correctable[ServoMemory]):
    """Planned once, then its target moved by the mean error at rest. See the module.

    Args:
        core: of the environment.
        wait: see the module.
        mean: tips, at most 16.
        enough: see the module.
        looks: first steps in which the inputs are held, at most 16.
    """

    knows = "the nominal design; its own commands; mean tip at rest"
    planner_class: type[ReachController] = ClosedFormSquares
    largest = 0.05  # [m]
    tunable: ClassVar[dict[str, tuple[float, ...]]] = {"wait": (3, 4, 6), "mean": (5, 8, 12), "enough": (0.2, 0.4, 0.6)}

    def __init__(self, core: Core, wait: int = 4, mean: int = 10, enough: float = 0.4, looks: int = 0) -> None:
        super().__init__(core)
        self.wait, self.mean, self.enough, self.looks = wait, mean, enough, looks
        self.planner = self.planner_class(core)

    def _take(self, design: DualTriangleDesign) -> None:
        super()._take(design)
        if hasattr(self, "planner"):
            self.planner.begin_episodes(np.ones(1, bool), design)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> ServoMemory:
        """See `AnalyticController.initial`."""
        inputs, tips = observed.inputs, first_tips(observed.tip)
        plan = self.planner.held(observed) if self.looks else self.planner.initial(observed, index)
        end, looks = ends_of_plans(plan.plan, _STILL), np.full(len(index), self.looks > 0)
        return ServoMemory(plan, inputs, tips, np.zeros((len(index), 2)), end, looks, np.zeros_like(inputs))

    def _act(self, observed: DecodedObservation, memory: ServoMemory) -> tuple[np.ndarray, ServoMemory]:
        tips = with_latest(memory.tips, observed.tip)
        memory = memory._replace(tips=tips)
        has_looked = memory.looks & (memory.plan.step == self.looks)
        if has_looked.any():
            looked = np.flatnonzero(has_looked)
            memory = self._planned_anew(observed, memory, looked, self.looks, np.zeros((len(looked), 2)))
            memory = memory._replace(looks=memory.looks & ~has_looked)
        error = np.hypot(*(observed.target - tips[:, : self.mean].mean(axis=1)).T)
        rests = ~memory.looks & (memory.plan.step >= memory.end + self.wait + self.mean)
        again = np.flatnonzero(rests & (error > self.enough * self.core.task.tolerance))
        if len(again):
            shift = memory.shift[again] + self._shift(observed.take(again).replace(tip=self._mean(memory, again)))
            memory = self._planned_anew(observed, memory, again, self.mean, shift)
        rows, plan = np.arange(len(tips)), memory.plan
        wanted = plan.plan[rows, np.minimum(plan.step, plan.plan.shape[1] - 1)]
        action = np.clip((wanted - memory.inputs) / self.rate, -1.0, 1.0)
        bound = self.planner.bound
        inputs = np.clip(memory.inputs + self.rate * action, -bound, bound)
        return action, memory._replace(plan=plan._replace(step=plan.step + 1), inputs=inputs)

    def given(self, before: ServoMemory, after: ServoMemory, action: np.ndarray) -> ServoMemory:
        """See `Correctable.given`. The plan goes on from where the command has come to."""
        bound = self.planner.bound
        inputs = np.clip(before.inputs + self.rate * action, -bound, bound)
        by = inputs - after.inputs
        moved = np.clip(after.plan.plan + by[:, None], -bound, bound)
        return after._replace(plan=after.plan._replace(plan=moved), inputs=inputs, added=after.added + by)

    def added(self, memory: ServoMemory) -> np.ndarray:
        """See `Correctable.added`."""
        return np.asarray(memory.added / self.rate)

    def looks_at_rest(self, memory: ServoMemory) -> np.ndarray:
        """See `Correctable.looks_at_rest`."""
        return np.asarray(memory.looks)

    @property
    def outlook_size(self) -> int:
        """See `Correctable.outlook_size`."""
        return self.core.simulation.action_size + 5

    def outlook(self, observed: DecodedObservation, memory: ServoMemory) -> np.ndarray:
        """See `Correctable.outlook`: the way to the end of the plan, and the time; and the error of the mean of the
        latest tips, of `mean` and of 16, so that noise is averaged.
        """
        way = (memory.plan.plan[:, -1] - memory.inputs) / (_FAR * self.rate)
        time = np.clip((memory.end - memory.plan.step) / _SOON, -1.0, 1.0)[:, None]
        means = [memory.tips[:, :count].mean(axis=1) for count in (self.mean, LATEST)]
        errors = [(observed.target - mean) / (_NEAR * self.core.task.tolerance) for mean in means]
        return np.concatenate([way, time, *errors], axis=1)

    def _mean(self, memory: ServoMemory, index: np.ndarray) -> np.ndarray:
        """Mean of the latest tips of the environments at `index`, (len(index), 2) [m]."""
        return np.asarray(memory.tips[index, : self.mean].mean(axis=1))

    def _planned_anew(
        self, observed: DecodedObservation, memory: ServoMemory, index: np.ndarray, count: int, shift: np.ndarray
    ) -> ServoMemory:
        """The memory with new plans for the environments at `index`, where there are any, from the mean of so many
        tips to targets that are shifted (len(index), 2) [m].
        """
        tip = memory.tips[index, :count].mean(axis=1)
        seen = observed.take(index).replace(tip=tip, inputs=memory.inputs[index])
        plan = self.planner.initial(seen.replace(target=seen.target + shift), index)
        fine = np.isfinite(plan.plan).all(axis=(1, 2))  # a target that was moved may be out of reach
        index, shift, plan = index[fine], shift[fine], rows_of(plan, np.flatnonzero(fine))
        shifts, ends, added = memory.shift.copy(), memory.end.copy(), memory.added.copy()
        shifts[index], ends[index], added[index] = shift, ends_of_plans(plan.plan, _STILL), 0.0
        return memory._replace(plan=with_rows(memory.plan, index, plan), shift=shifts, end=ends, added=added)

    def _shift(self, seen: DecodedObservation) -> np.ndarray:
        """By how much the target is moved, (n, 2) [m]."""
        error = seen.target - seen.tip
        length = np.maximum(np.hypot(*error.T)[:, None], 1e-12)
        return np.asarray(error * np.minimum(1.0, self.largest / length))


class IdentifyingObserver(Servo):
    """Identifies the load again from the mean tip at rest, and plans with it. See the module."""

    knows = "the nominal design; its own commands; identifies the load from tip and command, again at rest"
    planner_class = Observer
    tunable: ClassVar[dict[str, tuple[float, ...]]] = {
        "looks": (0, 8, 12, 16),
        "wait": (2, 4),
        "mean": (5, 8, 12),
        "enough": (0.4, 0.8),
    }

    def _shift(self, seen: DecodedObservation) -> np.ndarray:
        return np.zeros_like(seen.tip)
