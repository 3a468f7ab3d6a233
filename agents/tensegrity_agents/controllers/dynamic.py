"""The analytic controllers in dynamics: made for mechanisms at rest, they are led along smooth ramps, or damped.

Both wrap a controller of the quasi-static environments and work in the space of the inputs, so they are the same for
every mechanism. They add what those lack: a time course that does not set the arm swinging, and active damping.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController, Observation, jacobian_at, rows_of
from tensegrity_agents.controllers.resting import ends_of_plans, planned_at
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation import Episode

Pace = Literal["full", "shaped", "smooth"]
ADDS = {"full": "at full speed", "shaped": "shaped (ZVD)", "smooth": "smooth ramp"}
_PLANNED = 100  # steps of the quasi-static controller that are laid out in advance
_STILL = 1e-6  # of the range of the inputs: a plan that moves less rests
_PEAK = 15 / 8  # largest speed of the minimum-jerk time course, 1 being the mean
_COURSE = int(_PEAK * _PLANNED)  # steps of a course


Memory = TypeVar("Memory", bound=tuple[Any, ...])
Base = Callable[[Core], Any]  # makes the quasi-static controller for a core


class Adapted(AnalyticController[Memory]):
    """A quasi-static controller adapted to dynamics.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
        adds: what is added to its information set and to what it does, in words.

    Attributes:
        base: the quasi-static controller.
        low, high: bounds of the inputs.
    """

    def __init__(self, core: Core, base: Base, adds: str) -> None:
        super().__init__(core)
        self.base: Any = base(core)
        self.knows = f"{self.base.knows}; {adds}"
        self.wants_privileged = self.base.wants_privileged
        self.is_told_ranges = self.is_told_ranges or self.base.is_told_ranges
        simulation: Any = core.simulation
        self.simulation, (self.low, self.high) = simulation, simulation.bounds(core.nominal)

    def begin_episodes(self, mask: np.ndarray, design: Any, privileged: Episode | None = None) -> None:
        """Hand over what the quasi-static controller asks for."""
        super().begin_episodes(mask, design, privileged)
        self.base.begin_episodes(mask, design, privileged)

    def action_to(self, wanted: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """Actions that bring the inputs to the wanted ones, shape (n, inputs), within bounds."""
        return np.asarray((np.clip(wanted, self.low, self.high) - inputs) / self.rate)

    def decode(self, observation: Observation) -> DecodedObservation:
        """The observation in SI units, and `encoded`: the entry "observation" as it is."""
        observed: DecodedObservation = self.base.decode(observation)
        return observed.replace(encoded=np.asarray(observation["observation"], float))

    def with_inputs(self, observed: DecodedObservation, inputs: np.ndarray) -> Observation:
        """The observations, encoded, of the same mechanisms with other inputs, shape (n, inputs)."""
        seen = {"observation": observed.encoded, "achieved_goal": observed.tip, "desired_goal": observed.target}
        return self.core.schema.with_values(seen, "inputs", inputs)


class Damped(Adapted[Memory]):
    """What ramps and damped controllers share: active damping, and holding the inputs on a plan.

    Damping adds to the planned inputs u what gives the joint torques -c M velocity, or, where only the tip is observed,
    the tip force -c Lambda velocity, M being the arm's mass matrix at q = 0 (with the nominal masses), Lambda that of
    the tip. The least squares change of the inputs does that; what exceeds the rate or the bounds is lost.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
        adds: see `Adapted`.
    """

    damping = 5.0  # c [1/s]

    def __init__(self, core: Core, base: Base, adds: str) -> None:
        super().__init__(core, base, adds)
        engine = core.engine
        assert engine is not None
        self.model, self.joints = engine.model, int(engine.joints)

    @cached_property
    def mass(self) -> np.ndarray:
        """The arm's mass matrix at q = 0 [kg m2], shape (joints, joints)."""
        return np.asarray(self.model.mass_matrix(np.zeros(self.joints)))

    def damped(self, observed: DecodedObservation, inputs: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Actions that bring the inputs to the planned ones, shape (n, inputs), and damp.

        Args:
            observed: the observation.
            inputs: planned.
            q: where the arm is, or is believed to be, shape (n, joints) [rad].
        """
        return self.resisting(observed, inputs, q, self.damping_torque(observed, q))

    def damping_torque(self, observed: DecodedObservation, q: np.ndarray) -> np.ndarray:
        """What damping takes off the joints, shape (n, joints) [N m]; see the class."""
        if "joint_angles" in observed:
            return np.asarray(self.damping * observed.joint_rates @ self.mass)
        jacobian = jacobian_at(self.core.nominal, tuple(q.T))
        mobility = np.einsum("nij,jk,nlk->nil", jacobian, np.linalg.inv(self.mass), jacobian)
        # Where the arm is stretched the tip cannot move in one direction, and nothing is to be damped there.
        tip_mass = np.linalg.inv(mobility + 0.02 * np.trace(mobility, axis1=1, axis2=2)[:, None, None] * np.eye(2))
        return np.asarray(self.damping * np.einsum("nij,nik,nk->nj", jacobian, tip_mass, observed.tip_velocity))

    def resisting(
        self, observed: DecodedObservation, inputs: np.ndarray, q: np.ndarray, torque: np.ndarray
    ) -> np.ndarray:
        """Actions that bring the inputs to the planned ones, shape (n, inputs), and take torques off the joints.

        Args:
            observed: the observation.
            inputs: planned.
            q: where the arm is, or is believed to be, shape (n, joints) [rad].
            torque: shape (n, joints) [N m].
        """
        effect = self._effect(q, observed.inputs)
        normal = np.einsum("nji,nki->njk", effect, effect)
        normal += 1e-6 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(self.joints)
        change = np.einsum("nji,njk,nk->ni", effect, np.linalg.inv(normal), torque)
        return self.action_to(inputs + change, observed.inputs)

    def _effect(self, q: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """d (energy gradient) / d inputs, shape (n, joints, inputs): the gradient is linear in them."""
        arm, simulation = self.core.nominal, self.simulation
        at = tuple(q.T)

        def gradient(values: np.ndarray) -> np.ndarray:
            rows = arm.energy_gradient(at, simulation.actuation(arm, tuple(values.T)))
            return np.stack([np.broadcast_to(row, len(q)) for row in rows], axis=1)

        step = 0.01 * (self.high - self.low)
        columns = [(gradient(inputs + step * e) - gradient(inputs)) / step for e in np.eye(inputs.shape[1])]
        return np.stack(columns, axis=2)

    def resting(self, inputs: np.ndarray) -> np.ndarray:
        """Configurations (n, joints) [rad] in which the nominal arm would rest, without a load."""
        arm = self.core.nominal
        actuation = self.simulation.actuation(arm, tuple(inputs.T))
        rest = arm.equilibrium(actuation, tuple(np.zeros((self.joints, len(inputs)))))
        return np.stack(rest.configuration, axis=1)

    def believed(self, observed: DecodedObservation, inputs: np.ndarray) -> np.ndarray:
        """Configurations (n, joints) [rad]: observed, or else where the nominal arm would rest."""
        return observed.joint_angles if "joint_angles" in observed else self.resting(inputs)


class RampMemory(NamedTuple):
    """What a ramp carries from step to step.

    Attributes:
        plan: inputs after each step, shape (n, steps, inputs).
        step: of the episode, shape (n,).
    """

    plan: np.ndarray
    step: np.ndarray


class Planned(Damped[Memory]):
    """The inputs that a quasi-static controller would give are planned when the episode begins.

    `pace` says how they are followed: "smooth" along a minimum-jerk time course (10 s^3 - 15 s^4 + 6 s^5), no faster
    than the inputs' rate, in at least `shortest` steps; or "full", as they are. Then the inputs are held.
    """

    shortest = 60
    pace: Pace = "smooth"

    def _plan(self, observed: DecodedObservation, index: np.ndarray, shortest: int | None = None) -> np.ndarray:
        """Inputs after each step of the environments at `index`: what the quasi-static controller does, its mechanism
        being where it says. A smooth course takes at least `shortest` steps, by default those of the class.
        """
        start = np.ones(len(index), bool)
        self.base.begin_episodes(start, self.nominal.design, rows_of(self.privileged, index))
        inputs, state = observed.inputs, None
        path = [inputs]
        for _ in range(_PLANNED):
            action, state = self.base.predict(self.with_inputs(observed, inputs), state, start, deterministic=True)
            inputs = np.clip(inputs + self.rate * action, self.low, self.high)
            path.append(inputs)
            start = np.zeros(len(index), bool)
        laid_out = np.stack(path, axis=1)
        if self.pace != "smooth":
            return laid_out[:, 1:]
        return self._smoothed(laid_out, self.shortest if shortest is None else shortest)

    def _ends(self, plan: np.ndarray) -> np.ndarray:
        """The steps from which on plans (n, steps, inputs) rest, (n,)."""
        return ends_of_plans(plan, _STILL * float(self.high - self.low))

    def _smoothed(self, path: np.ndarray, shortest: int) -> np.ndarray:
        """The same path in the same shape, at another pace, in at least so many steps."""
        length = ends_of_plans(path, 1e-9 * (self.high - self.low))
        steps = np.maximum(np.ceil(_PEAK * length), shortest)
        s = np.minimum(np.arange(1, _COURSE + 1) / steps[:, None], 1.0)
        place = length[:, None] * (10 * s**3 - 15 * s**4 + 6 * s**5)
        before = np.minimum(np.floor(place).astype(int), path.shape[1] - 2)
        share = (place - before)[..., None]
        rows = np.arange(len(path))[:, None]
        return np.asarray((1 - share) * path[rows, before] + share * path[rows, before + 1])


class Ramp(Planned[RampMemory]):
    """The plan is followed smoothly, with active damping.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
    """

    def __init__(self, core: Core, base: Base) -> None:
        super().__init__(core, base, "smooth ramp, active damping")

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> RampMemory:
        """See `AnalyticController.initial`."""
        return RampMemory(self._plan(observed, index), np.zeros(len(index), int))

    def _act(self, observed: DecodedObservation, memory: RampMemory) -> tuple[np.ndarray, RampMemory]:
        wanted = planned_at(memory.plan, memory.step)
        action = self.damped(observed, wanted, self.believed(observed, wanted))
        return action, memory._replace(step=memory.step + 1)


class FeedbackMemory(NamedTuple):
    """What a damped feedback carries: the inputs that it has planned, and the memory of the quasi-static controller."""

    inputs: np.ndarray
    base: Any


class Feedback(Damped[FeedbackMemory]):
    """A quasi-static controller that feeds back the tip error: damped, and slowed down, not to drive the vibration.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
        slowed: share of its steps that is taken.
    """

    def __init__(self, core: Core, base: Base, slowed: float = 0.15) -> None:
        super().__init__(core, base, "slowed down, active damping")
        self.base.gain *= slowed
        # The steps move the commanded configuration, which is integral action already; more of it feeds the vibration.
        self.base.integral_gain = 0.0

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> FeedbackMemory:
        """See `AnalyticController.initial`."""
        return FeedbackMemory(observed.inputs, self.base.initial(observed, index))

    def _act(self, observed: DecodedObservation, memory: FeedbackMemory) -> tuple[np.ndarray, FeedbackMemory]:
        seen = self.base.decode(self.with_inputs(observed, memory.inputs))
        action, base = self.base.act(seen, memory.base)
        inputs = np.clip(memory.inputs + self.rate * action, self.low, self.high)
        return self.damped(observed, inputs, self.believed(observed, inputs)), FeedbackMemory(inputs, base)
