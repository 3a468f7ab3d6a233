"""The analytic controllers that reach with the 2-X manipulator, and the information set of each."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController, ragged
from tensegrity_agents.controllers.two_x.measurements import Estimate, configuration_from_tip, estimate_payload
from tensegrity_agents.controllers.two_x.planning import choose_solution, plan
from tensegrity_agents.controllers.two_x.tracking import joint_action, resolved_rate, tension_action
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation

_ARRIVED = 1e-3  # [rad] from a waypoint to the next


class Memory(NamedTuple):
    """What a controller carries from step to step, for n environments.

    Attributes:
        configuration: last known, (n, joints) [rad].
        commanded: that the last command aimed at, (n, joints) [rad].
        payload: believed, (n,) [kg].
        integral: of the tip error, (n, 2) [m].
        path: joint path of each environment, an object array (n,) of waypoints (k, joints) [rad].
        leg: number of the next waypoint, (n,).
    """

    configuration: np.ndarray
    commanded: np.ndarray
    payload: np.ndarray
    integral: np.ndarray
    path: np.ndarray
    leg: np.ndarray


class ReachController(AnalyticController[Memory]):
    """Believes something about arm and payload, plans a joint path when an episode begins, and goes along it.

    Subclasses say what to believe and where to go.

    Args:
        core: of the environment.
    """

    nominal: Any
    clearance = 0.0  # [-] of paths, see `choose_solution`

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.control = core.control

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> Memory:
        """See `AnalyticController.initial`."""
        memory = self.at_rest(observed, index)
        paths = self._paths(self.arm_with(memory.payload), memory.commanded, observed)
        return memory._replace(path=ragged(paths))

    def at_rest(self, observed: DecodedObservation, index: np.ndarray) -> Memory:
        """What is believed when an episode begins, and a path that leads nowhere."""
        configuration, commanded, payload = self._believed(observed, index)
        n = len(index)
        paths = ragged([point[None] for point in commanded])
        return Memory(configuration, commanded, payload, np.zeros((n, 2)), paths, np.zeros(n, int))

    def _believed(self, observed: DecodedObservation, index: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Configuration, configuration that the present inputs stand for, and payload, when an episode begins."""
        q = self.configuration_of(observed, None)
        commanded = q
        if self.control == "tension":
            # The command that the tensions stand for: where the nominal arm would be under them.
            rest = self.nominal.equilibrium(tuple(observed.tensions.T), tuple(q.T))
            commanded = np.where(np.asarray(rest.is_stable)[:, None], np.stack(rest.configuration, axis=1), q)
        return q, commanded, np.array(np.broadcast_to(np.asarray(self.nominal.design.payload, float), index.shape))

    def configuration_of(self, observed: DecodedObservation, near: np.ndarray | None) -> np.ndarray:
        """See `configuration_from_tip`."""
        return configuration_from_tip(self.nominal, observed, near)

    def choose(self, model: Any, start: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the solutions of each target the one to go to, and whether one can go straight; see `choose_solution`."""
        return choose_solution(model, start, target, self.clearance)

    def around(self, model: Any, start: np.ndarray, target: np.ndarray) -> list[np.ndarray]:
        """A path where one cannot go straight, of one arm; see `plan`."""
        return plan(model, start, target)

    def resolved_rate(self, q: np.ndarray, wanted: np.ndarray, damping: float) -> np.ndarray:
        """Joint steps for wanted tip steps; see `tracking.resolved_rate`."""
        return resolved_rate(self.nominal, q, wanted, damping)

    def estimate(self, observed: DecodedObservation) -> Estimate:
        """Configuration and payload; see `estimate_payload`."""
        return estimate_payload(self.nominal, observed)

    def arm_with(self, payload: np.ndarray) -> Any:
        """The arm as this controller believes it to be."""
        return self.nominal

    def _paths(self, model: Any, start: np.ndarray, observed: DecodedObservation) -> list[np.ndarray]:
        """Waypoints (k, joints) for the episodes that begin: the chosen inverse solution."""
        goal, _ = self.choose(model, start, observed.target)
        return [point[None] for point in goal]

    def paths_around(self, model: Any, start: np.ndarray, target: np.ndarray) -> list[np.ndarray]:
        """Waypoints (k, joints) to targets (n, 2) [m]: straight, or around what is infeasible where there is a way."""
        goal, straight = self.choose(model, start, target)
        paths = [point[None] for point in goal]
        for i in np.flatnonzero(~straight):
            around = self.around(model.take(i), start[i], target[i])
            if around:
                paths[i] = np.array(around)
        return paths

    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        configuration = self.configuration_of(observed, memory.configuration)
        return self.follow(observed, memory._replace(configuration=configuration))

    def next_waypoint(self, here: np.ndarray, memory: Memory) -> tuple[np.ndarray, Memory]:
        """The waypoints to go to from `here`, both (n, joints) [rad], and the memory where those visited are passed."""
        leg = memory.leg.copy()
        for i, path in enumerate(memory.path):
            while leg[i] < len(path) - 1 and np.abs(path[leg[i]] - here[i]).max() < _ARRIVED:
                leg[i] += 1
        return np.stack([path[k] for path, k in zip(memory.path, leg, strict=True)]), memory._replace(leg=leg)

    def follow(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        """Actions along the path, and what to remember."""
        here = memory.configuration if self.control == "joint" else memory.commanded
        goal, memory = self.next_waypoint(here, memory)
        if self.control == "joint":
            return joint_action(here, goal), memory
        action, commanded = tension_action(self.arm_with(memory.payload), here, goal, observed.tensions)
        return action, memory._replace(commanded=commanded)


class ClosedFormIK(ReachController):
    """All inverse solutions in closed form; the one whose straight joint path stays feasible and is shortest; then
    straight there.

    In cable control, the stiffest tensions of the *nominal* arm along the path.
    """

    knows = "the nominal design; plans once, no feedback"


class PseudoInverse(ReachController):
    """Resolved rate: joint steps from the damped pseudo-inverse of the Jacobian, with feedback and integral action
    on the tip error.

    In cable control the commanded configuration is moved by these steps, which is the integral action that makes up for
    an unknown load; the cables take the stiffest tensions of the nominal arm there.
    """

    knows = "the nominal design; feedback of the tip error"
    gain = 0.5
    integral_gain = 0.05
    damping = 0.02  # [m/rad]

    def _paths(self, model: Any, start: np.ndarray, observed: DecodedObservation) -> list[np.ndarray]:
        return [point[None] for point in start]  # it follows none

    def joint_step(self, observed: DecodedObservation, q: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Joint steps from configurations (n, joints) [rad] for wanted tip steps (n, 2) [m]."""
        return self.resolved_rate(q, wanted, self.damping)

    def follow(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        """See `ReachController.follow`: joint steps that the tip error asks for."""
        error = observed.target - observed.tip
        # Conditional integration: only close to the target, where the integral is to remove what is left.
        close = np.hypot(*error.T)[:, None] < 0.05
        integral = np.where(close, memory.integral + error, 0.0)
        wanted = self.gain * error + self.integral_gain * integral
        step = self.joint_step(observed, memory.configuration, wanted)
        memory = memory._replace(integral=integral)
        if self.control == "joint":
            return joint_action(memory.configuration, memory.configuration + step), memory
        limit = self.nominal.design.joint_limit
        goal = np.clip(memory.commanded + step, -limit, limit)
        action, commanded = tension_action(self.nominal, memory.commanded, goal, observed.tensions)
        return action, memory._replace(commanded=commanded)


class Observer(ReachController):
    """Solves payload and configuration from tip and tensions, then the closed form for that payload."""

    knows = "the nominal design; identifies the payload from tip and tensions"

    def _believed(self, observed: DecodedObservation, index: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        estimate = self.estimate(observed)
        return estimate.configuration, estimate.configuration, estimate.payload

    def arm_with(self, payload: np.ndarray) -> Any:
        """See `ReachController.arm_with`."""
        return self.core.mechanism(replace(self.nominal.design, payload=payload))


class Oracle(Observer):
    """Is given the true payload; where no straight joint path is feasible, it plans one around what is infeasible."""

    wants_privileged = True
    knows = "the true payload; plans paths inside the stable wrench-feasible set"

    def _believed(self, observed: DecodedObservation, index: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        configuration, commanded, _ = super()._believed(observed, index)
        payload = np.asarray(self.truth.design.payload, float)
        return configuration, commanded, payload[index] if payload.ndim else np.full(len(index), payload)

    def _paths(self, model: Any, start: np.ndarray, observed: DecodedObservation) -> list[np.ndarray]:
        return self.paths_around(model, start, observed.target)


class CarefulOracle(Oracle):
    """Of several straight paths it takes a longer one that keeps off the edge of the feasible set: a teacher of those
    who cannot follow as exactly.
    """

    clearance = 0.1
