"""The analytic controllers in dynamics: made for arms at rest, they are led along smooth ramps, or damped.

Both wrap a controller of the quasi-static environments and work in the space of the inputs, so they are the same for
every mechanism. They add what those lack: a time course that does not set the arm swinging, and active damping.
"""

from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import beginning
from tensegrity_envs.compiler.pytree import is_array, tree_map
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation

Pace = Literal["full", "shaped", "smooth"]
ADDS = {"full": "at full speed", "shaped": "shaped (ZVD)", "smooth": "smooth ramp"}
_PLANNED = 100  # steps of the quasi-static controller that are laid out in advance
_PEAK = 15 / 8  # largest speed of the minimum-jerk time course, 1 being the mean
_COURSE = int(_PEAK * _PLANNED)  # steps of a course


class Dynamic:
    """What ramps and damped controllers share: active damping, and holding the inputs on a plan.

    Damping adds to the planned inputs u what gives the joint torques -c M velocity, or, where only the tip is observed,
    the tip force -c Lambda velocity, M being the arm's mass matrix at q = 0 (with the nominal masses), Lambda that of
    the tip. The least squares change of the inputs does that; what exceeds the rate or the bounds is lost.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
    """

    damping = 5.0  # c [1/s]
    adds = ""

    def __init__(self, core: Core, base: Any) -> None:
        engine: Any = core.engine
        self.core = core
        self.base = base(core)
        self.knows = f"{self.base.knows}; {self.adds}"
        self.wants_privileged = getattr(self.base, "wants_privileged", False)
        simulation: Any = core.simulation
        self.rate = float(simulation.rate)
        self.low, self.high = simulation.bounds(core.nominal)
        self.joints = int(engine.joints)
        self.told: tuple[Any, Any] = core.design, None  # at the beginning of the episodes: design, privileged

    @cached_property
    def mass(self) -> np.ndarray:
        """The arm's mass matrix at q = 0 [kg m2], shape (joints, joints)."""
        engine: Any = self.core.engine
        return np.asarray(engine.model.mass_matrix(np.zeros(self.joints)))

    def begin_episodes(self, mask: np.ndarray, design: Any, privileged: Any = None) -> None:
        """Hand over what the quasi-static controller asks for."""
        self.told = design, privileged
        self.base.begin_episodes(mask, design, privileged)

    def damped(self, observed: DecodedObservation, inputs: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Actions that bring the inputs to the planned ones, shape (n, inputs), and damp.

        Args:
            observed: the observation.
            inputs: planned.
            q: where the arm is, or is believed to be, shape (n, joints) [rad].
        """
        if "joint_angles" in observed:
            torque = self.damping * observed.joint_rates @ self.mass
        else:
            jacobian = np.stack([np.stack(row, axis=1) for row in self.core.nominal.jacobian(tuple(q.T))], axis=1)
            mobility = np.einsum("nij,jk,nlk->nil", jacobian, np.linalg.inv(self.mass), jacobian)
            # Where the arm is stretched the tip cannot move in one direction, and nothing is to be damped there.
            tip_mass = np.linalg.inv(mobility + 0.02 * np.trace(mobility, axis1=1, axis2=2)[:, None, None] * np.eye(2))
            torque = self.damping * np.einsum("nij,nik,nk->nj", jacobian, tip_mass, observed.tip_velocity)
        effect = self._effect(q, observed.inputs)
        normal = np.einsum("nji,nki->njk", effect, effect)
        normal += 1e-6 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(self.joints)
        change = np.einsum("nji,njk,nk->ni", effect, np.linalg.inv(normal), torque)
        wanted = np.clip(inputs + change, self.low, self.high)
        return np.asarray(np.clip((wanted - observed.inputs) / self.rate, -1.0, 1.0))

    def _effect(self, q: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """d (energy gradient) / d inputs, shape (n, joints, inputs): the gradient is linear in them."""
        arm, simulation = self.core.nominal, self.core.simulation
        at = tuple(q.T)

        def gradient(values: np.ndarray) -> np.ndarray:
            rows = arm.energy_gradient(at, simulation.actuation(arm, tuple(values.T)))  # type: ignore[union-attr]
            return np.stack([np.broadcast_to(row, len(q)) for row in rows], axis=1)

        step = 0.01 * (self.high - self.low)
        columns = [(gradient(inputs + step * e) - gradient(inputs)) / step for e in np.eye(inputs.shape[1])]
        return np.stack(columns, axis=2)

    def resting(self, inputs: np.ndarray) -> np.ndarray:
        """Configurations (n, joints) [rad] in which the nominal arm would rest, without a load."""
        arm, simulation = self.core.nominal, self.core.simulation
        actuation = simulation.actuation(arm, tuple(inputs.T))  # type: ignore[union-attr]
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


class Ramp(Dynamic):
    """The inputs that a quasi-static controller would give, laid out when the episode begins and followed smoothly.

    Minimum-jerk time course (10 s^3 - 15 s^4 + 6 s^5), no faster than the inputs' rate, in at least `shortest` steps;
    then the inputs are held.
    """

    shortest = 60
    adds = "smooth ramp, active damping"

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, RampMemory]:
        """Actions (n, inputs) for a batch of n observations."""
        observed = self.core.schema.decode(observation)
        n = len(observed)
        fresh = beginning(n, state, episode_start)
        if state is None:
            state = RampMemory(np.zeros((n, _COURSE, self.core.simulation.action_size)), np.zeros(n, int))
        memory = RampMemory(*(np.array(part) for part in state))
        if fresh.any():
            index = np.flatnonzero(fresh)
            memory.plan[index], memory.step[index] = self._laid_out(observation, index), 0
        rows = np.arange(n)
        wanted = memory.plan[rows, np.minimum(memory.step, memory.plan.shape[1] - 1)]
        action = self.damped(observed, wanted, self.believed(observed, wanted))
        return action, memory._replace(step=memory.step + 1)

    def _laid_out(self, observation: Any, index: np.ndarray) -> np.ndarray:
        """The plans of some environments: what the quasi-static controller does, its arm being where it says."""
        part = {key: np.asarray(value)[index] for key, value in observation.items()}
        start = np.ones(len(index), bool)
        design, privileged = self.told
        self.base.begin_episodes(start, design, tree_map(lambda value: value[index], privileged, is_array))
        inputs, state = self.core.schema.decode(part).inputs, None
        path = [inputs]
        for _ in range(_PLANNED):
            imagined = self.core.schema.with_values(part, "inputs", inputs)
            action, state = self.base.predict(imagined, state, start, deterministic=True)
            inputs = np.clip(inputs + self.rate * action, self.low, self.high)
            path.append(inputs)
            start = np.zeros(len(index), bool)
        return self._smooth(np.stack(path, axis=1))

    def _smooth(self, path: np.ndarray) -> np.ndarray:
        """The same way in the same shape, at another pace."""
        moving = np.abs(np.diff(path, axis=1)).max(axis=2) > 1e-9 * (self.high - self.low)
        length = np.where(moving.any(axis=1), path.shape[1] - 1 - moving[:, ::-1].argmax(axis=1), 0)
        steps = np.maximum(np.ceil(_PEAK * length), self.shortest)
        s = np.minimum(np.arange(1, _COURSE + 1) / steps[:, None], 1.0)
        place = length[:, None] * (10 * s**3 - 15 * s**4 + 6 * s**5)
        before = np.minimum(np.floor(place).astype(int), path.shape[1] - 2)
        share = (place - before)[..., None]
        rows = np.arange(len(path))[:, None]
        return np.asarray((1 - share) * path[rows, before] + share * path[rows, before + 1])


class FeedbackMemory(NamedTuple):
    """What a damped feedback carries: the inputs that it has planned, and what the quasi-static controller carries."""

    inputs: np.ndarray
    base: Any


class Feedback(Dynamic):
    """A quasi-static controller that feeds back the tip error: damped, and slowed down, not to drive the vibration.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
        slowed: share of its steps that is taken.
    """

    adds = "slowed down, active damping"

    def __init__(self, core: Core, base: Any, slowed: float = 0.15) -> None:
        super().__init__(core, base)
        self.base.gain *= slowed
        # The steps move the commanded configuration, which is integral action already; more of it feeds the vibration.
        self.base.integral_gain = 0.0

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, FeedbackMemory]:
        """Actions (n, inputs) for a batch of n observations."""
        observed = self.core.schema.decode(observation)
        n = len(observed)
        fresh = beginning(n, state, episode_start)
        inputs = observed.inputs if state is None else np.where(fresh[:, None], observed.inputs, state.inputs)
        before = None if state is None else state.base
        imagined = self.core.schema.with_values(observation, "inputs", inputs)
        action, base = self.base.predict(imagined, before, fresh, deterministic=True)
        inputs = np.clip(inputs + self.rate * action, self.low, self.high)
        return self.damped(observed, inputs, self.believed(observed, inputs)), FeedbackMemory(inputs, base)
