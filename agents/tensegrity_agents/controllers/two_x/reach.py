"""The analytic controllers of the literature, and what each of them knows."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import Privileged, beginning
from tensegrity_agents.controllers.two_x.planning import choose_solution, plan
from tensegrity_agents.controllers.two_x.reading import configuration_from_tip, estimate_payload
from tensegrity_agents.controllers.two_x.tracking import joint_action, tension_action
from tensegrity_envs.core import Core
from tensegrity_envs.mechanics import TwoX, TwoXDesign
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation import Episode

_ARRIVED = 1e-3  # [rad] from a way point to the next


class Memory(NamedTuple):
    """What a controller carries from step to step, for n environments.

    Attributes:
        configuration: last known, (n, 2) [rad].
        commanded: that the last command aimed at, (n, 2) [rad].
        payload: believed, (n,) [kg].
        integral: of the tip error, (n, 2) [m].
        paths: way points (k, 2) still to be visited, of each environment.
    """

    configuration: np.ndarray
    commanded: np.ndarray
    payload: np.ndarray
    integral: np.ndarray
    paths: list[np.ndarray]


class AnalyticController:
    """Reads the observation, remembers what it needs, acts. Subclasses say what to believe and where to go.

    Args:
        core: of the environment.
    """

    wants_privileged = False
    knows = ""

    def __init__(self, core: Core) -> None:
        self.control = core.control
        self.schema = core.schema
        self.nominal: TwoX | None = None
        self.privileged: Episode | None = None

    def begin_episodes(self, mask: np.ndarray, design: TwoXDesign, privileged: Episode | None = None) -> None:
        """Take the nominal design and, if this controller asks for it, the true episodes."""
        self.nominal = TwoX(design)
        self.privileged = privileged

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Memory]:
        """Actions (n, size) for a batch of n observations."""
        if self.nominal is None:
            raise RuntimeError(f"{type(self).__name__}: call begin_episodes(mask, design) before predict")
        observed = self.schema.decode(observation)
        n = len(observed)
        fresh = beginning(n, state, episode_start)
        memory = self._perceive(observed, state, fresh)
        if fresh.any():
            index = np.flatnonzero(fresh)
            part = observed.take(index)
            for i, path in zip(
                index, self._paths(self._believed(memory, index), memory.commanded[index], part), strict=True
            ):
                memory.paths[i] = path
        return self._act(observed, memory)

    def _perceive(self, observed: DecodedObservation, memory: Memory | None, fresh: np.ndarray) -> Memory:
        """Configuration and payload as this controller believes them to be."""
        assert self.nominal is not None
        n = len(fresh)
        q = configuration_from_tip(self.nominal, observed, None)
        begun = q
        if self.control == "tension" and fresh.any():
            # The command that the tensions stand for: where the nominal arm would be under them.
            rest = self.nominal.equilibrium(tuple(observed.tensions.T), tuple(q.T))
            begun = np.where(np.asarray(rest.is_stable)[:, None], np.stack(rest.configuration, axis=1), q)
        if memory is None:
            payload = np.full(n, float(self.nominal.design.payload))
            return Memory(q, begun, payload, np.zeros((n, 2)), [np.zeros((0, 2))] * n)
        if "joint_angles" not in observed:
            q = np.where(fresh[:, None], q, configuration_from_tip(self.nominal, observed, memory.configuration))
        keep = ~fresh[:, None]
        return memory._replace(
            configuration=q,
            commanded=np.where(keep, memory.commanded, begun),
            integral=np.where(keep, memory.integral, 0.0),
        )

    def _believed(self, memory: Memory, index: np.ndarray | None = None) -> TwoX:
        """The arm as this controller believes it to be."""
        assert self.nominal is not None
        return self.nominal

    def _paths(self, model: TwoX, start: np.ndarray, observed: DecodedObservation) -> list[np.ndarray]:
        """Way points for the episodes that begin: the chosen inverse solution."""
        goal, _ = choose_solution(model, start, observed.target)
        return [point[None] for point in goal]

    def _goals(self, here: np.ndarray, memory: Memory) -> np.ndarray:
        """The next way point of each environment; those already visited are dropped."""
        goals = here.copy()
        for i, path in enumerate(memory.paths):
            while len(path) > 1 and np.abs(path[0] - here[i]).max() < _ARRIVED:
                path = path[1:]  # noqa: PLW2901
            memory.paths[i] = path
            if len(path):
                goals[i] = path[0]
        return goals

    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        if self.control == "joint":
            return joint_action(memory.configuration, self._goals(memory.configuration, memory)), memory
        goals = self._goals(memory.commanded, memory)
        action, commanded = tension_action(self._believed(memory), memory.commanded, goals, observed.tensions)
        return action, memory._replace(commanded=commanded)


class ClosedFormIK(AnalyticController):
    """All inverse solutions in closed form; the one whose straight joint path stays feasible and is shortest; then
    straight there.

    In cable control, the stiffest tensions of the *nominal* arm along the path.
    """

    knows = "the nominal design; plans once, no feedback"


class PseudoInverse(AnalyticController):
    """Resolved rate: joint steps from the damped pseudo-inverse of the Jacobian, with feedback and integral action
    on the tip error.

    In cable control the commanded configuration is moved by these steps, which is the integral action that makes up for
    an unknown load; the cables take the stiffest tensions of the nominal arm there.
    """

    knows = "the nominal design; feedback of the tip error"
    gain = 0.5
    integral_gain = 0.05
    damping = 0.02  # [m/rad]

    def _paths(self, model: TwoX, start: np.ndarray, observed: DecodedObservation) -> list[np.ndarray]:
        return [np.zeros((0, 2))] * len(start)

    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        assert self.nominal is not None
        error = observed.target - observed.tip
        # Conditional integration: only close to the target, where the integral is to remove what is left.
        close = np.hypot(*error.T)[:, None] < 0.05
        integral = np.where(close, memory.integral + error, 0.0)
        wanted = self.gain * error + self.integral_gain * integral
        (xa, xb), (ya, yb) = self.nominal.jacobian(tuple(memory.configuration.T))
        # J^T (J J^T + d^2 I)^-1, for 2 x 2 matrices
        d = self.damping**2
        m11, m12, m22 = xa * xa + xb * xb + d, xa * ya + xb * yb, ya * ya + yb * yb + d
        det = m11 * m22 - m12 * m12
        u, v = (m22 * wanted[:, 0] - m12 * wanted[:, 1]) / det, (m11 * wanted[:, 1] - m12 * wanted[:, 0]) / det
        step = np.stack([xa * u + ya * v, xb * u + yb * v], axis=1)
        memory = memory._replace(integral=integral)
        if self.control == "joint":
            return joint_action(memory.configuration, memory.configuration + step), memory
        limit = self.nominal.design.joint_limit
        goal = np.clip(memory.commanded + step, -limit, limit)
        action, commanded = tension_action(self.nominal, memory.commanded, goal, observed.tensions)
        return action, memory._replace(commanded=commanded)


class Observer(AnalyticController):
    """Solves payload and configuration from tip and tensions, then the closed form for that payload."""

    knows = "the nominal design; identifies the payload from tip and tensions"

    def _perceive(self, observed: DecodedObservation, memory: Memory | None, fresh: np.ndarray) -> Memory:
        assert self.nominal is not None
        believed = super()._perceive(observed, memory, fresh)
        if not fresh.any():  # the payload is constant within an episode
            return believed
        first = estimate_payload(self.nominal, observed)
        if memory is None:
            return believed._replace(
                configuration=first.configuration, commanded=first.configuration, payload=first.payload
            )
        new = fresh[:, None]
        return believed._replace(
            configuration=np.where(new, first.configuration, believed.configuration),
            commanded=np.where(new, first.configuration, believed.commanded),
            payload=np.where(fresh, first.payload, believed.payload),
        )

    def _believed(self, memory: Memory, index: np.ndarray | None = None) -> TwoX:
        assert self.nominal is not None
        payload = memory.payload if index is None else memory.payload[index]
        return TwoX(replace(self.nominal.design, payload=payload))


class Oracle(Privileged, Observer):
    """Told the true payload; where no straight joint path is feasible, plans one around the gaps of the feasible
    set.
    """

    knows = "the true payload; plans paths inside the stable wrench-feasible set"

    def _perceive(self, observed: DecodedObservation, memory: Memory | None, fresh: np.ndarray) -> Memory:
        assert self.privileged is not None
        told = np.broadcast_to(np.asarray(self.privileged.design.payload, float), fresh.shape)
        return super()._perceive(observed, memory, fresh)._replace(payload=told)

    def _paths(self, model: TwoX, start: np.ndarray, observed: DecodedObservation) -> list[np.ndarray]:
        goal, straight = choose_solution(model, start, observed.target)
        paths = [point[None] for point in goal]
        for i in np.flatnonzero(~straight):
            around = plan(model.take(i), start[i], observed.target[i])
            if around:
                paths[i] = np.array(around)
        return paths
