"""Controllers of a planar 4-bar mechanism that is not quite the nominal one, behind a delay, seen through noise.

All follow their own command u, not the measured lengths, u <- clip(u + rate a): a delay then moves the same inputs to
later steps. Measured lengths are those that act, without noise, so the delay does not enter what is identified.

The servo plans without a force. When the command has rested at the end of its path for `wait` steps, longer than the
delay, it moves the end slowly by the unloaded Jacobian J,

    u <- u + gain * J^T (J J^T + d^2 I)^-1 (target - tip),

turned aside where that would come close to a singularity.

The identifying observer measures, in every step, the force y on F across bar CF that explains the tip under the lengths
(`measurements.force_across`: y = t . f + noise, t being the direction across the bar). The tip's noise of standard
deviation s turns the bar, and bar DE with it, so that y is off by s times the stiffness of F along its circle. With h
the Hessian of the energy over (theta, gamma) without a force,

    s_y = s |h_22 - h_12^2 / h_11| / L^2,
    Lambda <- Lambda + t t^T / s_y^2,    eta <- eta + t y / s_y^2,    f = Lambda^-1 eta,

recursive least squares, from Lambda = 2 I / f_max^2: a force of any direction and of a size up to f_max has so much
variance in each axis. One posture tells one component of f; the way to the target tells the other one. Where the
mechanism is under u is followed in the nominal model under f, from the measured state, and the path is planned from
there anew when f has changed by `changed` K L, or when u rests at its end and that place is more than `enough`
tolerances off the target; not more often than every `wait` steps. Where no path leads to the target as f is believed,
and in the first step, it takes a small step, the safest of eight, which tells more. Configurations depend on the force
divided by the stiffness alone: another stiffness is told as another force.
"""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np

from tensegrity_agents.controllers.planar_four_bar.corners import ByCorners
from tensegrity_agents.controllers.planar_four_bar.measurements import (
    configuration,
    force_across,
    resolved_rate,
    side,
    with_posture,
)
from tensegrity_agents.controllers.planar_four_bar.planning import LEGS, trips
from tensegrity_agents.controllers.planar_four_bar.reach import (
    ClosedFormIK,
    Memory,
    Observer,
    PseudoInverse,
    ReachController,
    onward,
)
from tensegrity_envs.core import Core
from tensegrity_envs.environments import PlanarFourBarReach
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation.protocol import Episode

_STILL = 1e-4  # of the rate: so near to its end a path is over
_LEAST_NOISE = 1e-5  # of the bars' length: of a tip without noise
_LEAST_FORCE = 1e-5  # [K L]: what no measurement of a force is better than


class ServoMemory(NamedTuple):
    """What is carried from step to step, for n environments.

    Attributes:
        plan: of the path, and of what is known of the force.
        inputs: the command u, (n, 2) [m].
        wished: where the controller's own latest action would have led it, (n, 2) [m]; an agent may have added to that.
        waited: steps since the command came to the end of the path, or since the path was planned, (n,).
    """

    plan: Memory
    inputs: np.ndarray
    wished: np.ndarray
    waited: np.ndarray


class OwnCommand(ByCorners[ServoMemory]):
    """Follows a path by its own command. See the module.

    Args:
        core: of the environment.
    """

    planner_class: ClassVar[type[ReachController]] = Observer
    nominal: PlanarFourBar

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.planner = self.planner_class(core)

    def begin_episodes(self, mask: np.ndarray, design: object, privileged: Episode | None = None) -> None:
        """See `AnalyticController.begin_episodes`."""
        super().begin_episodes(mask, design, privileged)
        self.planner.begin_episodes(mask, design, privileged)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> ServoMemory:
        """See `AnalyticController.initial`."""
        plan = self.planner.initial(observed, index)
        lengths = observed.actuator_lengths
        return ServoMemory(plan, lengths, lengths, np.zeros(len(index), int))

    def _act(self, observed: DecodedObservation, memory: ServoMemory) -> tuple[np.ndarray, ServoMemory]:
        action, memory = self._move(observed, memory)
        action = np.clip(action, -1.0, 1.0)
        plan, inputs = memory.plan._replace(step=memory.plan.step + 1), self._driven(memory.inputs, action)
        return action, memory._replace(plan=plan, inputs=inputs, wished=inputs)

    def given(self, before: ServoMemory, after: ServoMemory, action: np.ndarray) -> ServoMemory:
        """See `Correctable.given`."""
        return after._replace(plan=onward(after.plan, action), inputs=self._driven(before.inputs, action))

    def course(self, observed: DecodedObservation, memory: ServoMemory) -> tuple[Memory, np.ndarray, np.ndarray]:
        """See `ByCorners.course`."""
        return memory.plan, memory.inputs, self.planner.load(observed, memory.plan)

    def steps(self, memory: ServoMemory) -> np.ndarray:
        """See `ByCorners.steps`."""
        return memory.plan.step

    def _driven(self, inputs: np.ndarray, action: np.ndarray) -> np.ndarray:
        """The command after an action."""
        return np.asarray(np.clip(inputs + self.rate * action, *self.planner.bounds))

    @abstractmethod
    def _move(self, observed: DecodedObservation, memory: ServoMemory) -> tuple[np.ndarray, ServoMemory]:
        """Actions (n, 2), and what to remember but for the command."""

    def _rests(self, memory: ServoMemory) -> np.ndarray:
        """Whether the command is at the end of the path, or would be but for what an agent has added, (n,)."""
        return np.asarray(np.abs(memory.plan.path[:, -1] - memory.wished).max(axis=1) < _STILL * self.rate)

    def _along(self, observed: DecodedObservation, memory: ServoMemory) -> tuple[np.ndarray, ServoMemory]:
        """Actions along the path from the command on."""
        action, plan = self.planner.along(observed.replace(actuator_lengths=memory.inputs), memory.plan)
        return action, memory._replace(plan=plan)


class Servo(OwnCommand):
    """Planned once without a force, then moved slowly by the error at rest. See the module."""

    knows = "the nominal design; its own commands; feedback of the tip error at rest"
    planner_class = ClosedFormIK
    gain = 0.1
    wait = 4  # steps
    damping = 0.1  # d
    tunable: ClassVar[dict[str, tuple[float, ...]]] = {"gain": (0.05, 0.1, 0.15), "wait": (2, 4)}

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.feedback = PseudoInverse(core)

    def _move(self, observed: DecodedObservation, memory: ServoMemory) -> tuple[np.ndarray, ServoMemory]:
        plan = self.planner.planned(observed, memory.plan, np.flatnonzero(memory.plan.step == 0))
        memory = memory._replace(plan=plan)
        rests = self._rests(memory)
        action, memory = self._along(observed, memory)
        error, here = self.gain * (observed.target - observed.tip), side(self.nominal, observed)
        step = resolved_rate(self.nominal, memory.inputs, here, error, self.damping)
        step /= np.maximum(np.abs(step).max(axis=1, keepdims=True) / self.rate, 1.0)
        step = self.feedback.turned_aside(memory.inputs, step)
        moves = rests & (memory.waited >= self.wait)
        ends = np.where(moves[:, None, None], (memory.inputs + step)[:, None], memory.plan.path)
        action = np.where(moves[:, None], step / self.rate, action)
        waited = np.where(rests, memory.waited + 1, 0)
        return action, memory._replace(plan=memory.plan._replace(path=ends), waited=waited)


class Replanning(OwnCommand):
    """Plans under the force that is believed in, again when that changes. Subclasses say which that is."""

    wait = 0  # steps
    changed = 0.01  # [K L]
    enough = 0.3  # tolerances

    def _move(self, observed: DecodedObservation, memory: ServoMemory) -> tuple[np.ndarray, ServoMemory]:
        memory = memory._replace(plan=self._measured(observed, memory.plan))
        load = self.planner.load(observed, memory.plan)
        here = self._under_command(observed, memory.inputs, load)
        error = np.hypot(*(here.target - here.tip).T)
        off = np.hypot(*(load - memory.plan.load).T)  # NaN: never planned
        wrong = np.where(
            self._rests(memory),
            error > self.enough * self.core.task.tolerance,
            off > self.changed * float(self.nominal.largest_force),
        )
        again = np.isnan(off) | (wrong & (memory.waited >= self.wait))
        again &= memory.plan.step >= self.looks
        memory = self._replanned(here, memory, np.flatnonzero(again))
        action, memory = self._along(observed, memory)
        lost = np.flatnonzero(self._rests(memory) & (error > self.core.task.tolerance))
        if len(lost):
            action[lost] = self.planner.safest(here.take(lost), load[lost])
            ends = memory.plan.path.copy()
            ends[lost] = np.clip(memory.inputs[lost] + self.rate * action[lost], *self.planner.bounds)[:, None]
            memory = memory._replace(plan=memory.plan._replace(path=ends))
        return action, memory

    def _measured(self, observed: DecodedObservation, plan: Memory) -> Memory:
        """What is known of the force after a measurement; here always the same."""
        return plan

    def _replanned(self, here: DecodedObservation, memory: ServoMemory, index: np.ndarray) -> ServoMemory:
        """The memory with new paths for the environments at `index`; where there are none, the command is the end."""
        ends, waited = memory.plan.path.copy(), memory.waited + 1
        ends[index], waited[index] = memory.inputs[index][:, None], 0
        return memory._replace(plan=self.planner.planned(here, memory.plan._replace(path=ends), index), waited=waited)

    def _under_command(self, observed: DecodedObservation, inputs: np.ndarray, load: np.ndarray) -> DecodedObservation:
        """The observations of when the command (n, 2) acts and the mechanism rests, as the nominal model has it."""
        points = np.stack([observed.actuator_lengths, *[inputs] * LEGS], axis=1)
        tip, _ = trips(self.nominal, configuration(self.nominal, observed), points, load)
        return observed.replace(tip=tip, actuator_lengths=inputs)


class IdentifyingObserver(Replanning):
    """Identifies the force on the way, by recursive least squares, and plans with it. See the module."""

    knows = "the nominal design and the ranges of force, stiffness and noise; identifies the force on the way"
    is_told_ranges = True
    tunable: ClassVar[dict[str, tuple[float, ...]]] = {
        "wait": (0, 3, 6),
        "changed": (0.005, 0.01, 0.02),
        "enough": (0.2, 0.3, 0.5),
    }
    looks = 1

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        assert isinstance(core, PlanarFourBarReach)
        drawn = core.randomization
        softest, _ = drawn.stiffness or (1.0, 1.0)
        self.largest = float(self.nominal.largest_force) * max(core.sampler.load_range[1], _LEAST_FORCE) / softest
        self.noise = max(drawn.tip_noise, _LEAST_NOISE * float(self.nominal.length))

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> ServoMemory:
        """See `AnalyticController.initial`."""
        memory = super().initial(observed, index)
        information = np.tile(2 / self.largest**2 * np.eye(2), (len(index), 1, 1))
        return memory._replace(plan=memory.plan._replace(information=information))

    def _measured(self, observed: DecodedObservation, plan: Memory) -> Memory:
        across, force = force_across(self.nominal, observed)
        spread = np.maximum(self.noise * self._slope(observed), _LEAST_FORCE * float(self.nominal.largest_force))
        known = with_posture(plan.information, plan.evidence, across / spread[:, None], force / spread)
        return plan._replace(information=known[0], evidence=known[1])

    def _slope(self, observed: DecodedObservation) -> np.ndarray:
        """By how much the force across bar CF changes with the tip along its circle, (n,) [N/m]."""
        q = tuple(configuration(self.nominal, observed).T)
        (h11, h12), (_, h22) = self.nominal.stiffness_matrix(q, tuple(observed.actuator_lengths.T))
        return np.asarray(np.abs(h22 - h12 * h12 / h11) / float(self.nominal.length) ** 2)
