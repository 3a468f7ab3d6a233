"""Controllers of the 2-X for an arm that is not quite the nominal one, behind a delay, seen through noise.

The servo plans a joint path and sends the stiffest tensions along it as feedforward. It tracks its own command u,

    u <- clip(u + rate * action),

not the measured tensions: a delay then moves the same inputs to later steps, where feedback would run after itself.
When the command has rested at the end of the path for `wait` steps, longer than the delay, it moves the end slowly by

    c <- c + gain * J^T (J J^T + d^2 I)^-1 (target - tip),

an integral in joint space, which removes what the nominal model does not know and averages the noise.

The identifying observer has a filter beside that, of the factors s of the stiffness and m of the bars' mass, and of the
payload p. The two equations of equilibrium are linear in them,

    g(q, u) = g_0(q, u) + s g_s(q) + m g_m(q) + p g_p(q) = 0,

g_s and g_m being the springs' and the bars' part of the energy gradient, and g_p = gravity * d y / d q. So every step
gives a measurement H x = -g_0 with H = [g_s g_m g_p], x = (s, m, p). Its error is what the noise of q makes of the
gradient: covariance K S_q K^T, K being the stiffness matrix, S_q that of the measured angles, or J^-1 S_tip J^-T where
the tip alone is seen. Recursive least squares (a Kalman filter of constants) start from the ranges of s, m and p, and
leave out what is more than `gate` standard deviations off: a configuration on the wrong branch. Measured tensions are
those that act, whatever the delay, so the delay does not enter. The stiffest tensions are those of the arm as it is
believed to be in that step.
"""

from dataclasses import replace
from typing import ClassVar, NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController, jacobian_at
from tensegrity_agents.controllers.two_x.measurements import configuration_from_tip
from tensegrity_agents.controllers.two_x.reach import Memory, Observer
from tensegrity_agents.controllers.two_x.tracking import joint_action, resolved_rate, tension_action
from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.core import Core
from tensegrity_envs.mechanics import TwoX, TwoXDesign
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation import TensionControl

_LARGEST = 0.1  # [rad] of a correction
_KNOWN = 1e-10  # variance of what is not uncertain
_FLOOR = 1e-4  # [rad] or [m]: errors of angles or tips that the filter reckons with at least


class Belief(NamedTuple):
    """What is believed of n arms.

    Attributes:
        mean: factors of stiffness and bars' mass, and payload [kg], (n, 3).
        covariance: of these, (n, 3, 3).
    """

    mean: np.ndarray
    covariance: np.ndarray


class ServoMemory(NamedTuple):
    """What a servo carries from step to step, for n environments.

    Attributes:
        plan: of the observer that plans; its `commanded` is where the command leads, its `integral` the correction c of
            the end of the path [rad].
        inputs: the command u, (n, 4) [N].
        rested: steps since the command came to the end of the path, (n,).
        belief: about the arms.
    """

    plan: Memory
    inputs: np.ndarray
    rested: np.ndarray
    belief: Belief


class Servo(AnalyticController[ServoMemory]):
    """Planned path, feedforward along its own command, slow integral after a wait. See the module.

    Args:
        core: of the environment.
    """

    knows = "the nominal design; its own commands; feedback of the tip error at rest"
    gain = 0.15
    wait = 4  # steps
    damping = 0.1  # d [m/rad]
    near = 0.03  # [rad]: so near to its end the path is over
    clearance = 0.1  # [-] of paths: the arm is not quite the one that is planned with
    tunable: ClassVar[dict[str, tuple[float, ...]]] = {
        "gain": (0.05, 0.1, 0.15, 0.25),
        "wait": (2, 4, 8),
        "damping": (0.02, 0.05, 0.1),
    }
    nominal: TwoX

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.control = core.control
        self.planner = Observer(core)
        self.planner.clearance = self.clearance

    def _take(self, design: TwoXDesign) -> None:
        super()._take(design)
        if hasattr(self, "planner"):
            self.planner.begin_episodes(np.ones(1, bool), design)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> ServoMemory:
        """See `AnalyticController.initial`."""
        plan = self.planner.initial(observed, index)
        n = len(index)
        mean = np.stack([np.ones(n), np.ones(n), plan.payload], axis=1)
        return ServoMemory(plan, observed.tensions, np.zeros(n, int), Belief(mean, np.zeros((n, 3, 3))))

    def _act(self, observed: DecodedObservation, memory: ServoMemory) -> tuple[np.ndarray, ServoMemory]:
        plan, limit = memory.plan, self.nominal.design.joint_limit
        q = configuration_from_tip(self.nominal, observed, plan.configuration)
        belief = self.updated(memory.belief, q, observed)
        waypoint, plan = self.planner.next_waypoint(plan.commanded, plan._replace(configuration=q))
        goal = np.clip(waypoint + plan.integral, -limit, limit)
        last = plan.leg == np.array([len(path) - 1 for path in plan.path])
        rests = last & (np.abs(goal - plan.commanded).max(axis=1) < self.near)
        rested = np.where(rests, memory.rested + 1, 0)
        step = resolved_rate(self.nominal, plan.commanded, observed.target - observed.tip, self.damping)
        step *= self.gain * np.minimum(1.0, _LARGEST / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
        correction = plan.integral + np.where((rested > self.wait)[:, None], step, 0.0)
        goal = np.clip(waypoint + correction, -limit, limit)
        if self.control == "joint":
            action, inputs = joint_action(plan.commanded, goal), memory.inputs
            commanded = plan.commanded + self.rate * np.clip(action, -1.0, 1.0)
        else:
            action, commanded = tension_action(self.arm(belief), plan.commanded, goal, memory.inputs)
            low, high = self.nominal.design.min_tension, self.nominal.design.max_tension
            inputs = np.clip(memory.inputs + TensionControl.rate * np.clip(action, -1.0, 1.0), low, high)
        plan = plan._replace(commanded=commanded, integral=correction)
        return action, ServoMemory(plan, inputs, rested, belief)

    def updated(self, belief: Belief, q: np.ndarray, observed: DecodedObservation) -> Belief:
        """What is believed after a measurement; here always the same."""
        return belief

    def arm(self, belief: Belief) -> TwoX:
        """The arms as they are believed to be."""
        stiffness, mass, payload = belief.mean.T
        return TwoX(_varied(self.nominal.design, stiffness, mass, payload))


class IdentifyingObserver(Servo):
    """A servo that identifies stiffness, mass and payload on the way, by recursive least squares. See the module."""

    knows = "the nominal design and the ranges of stiffness, mass, payload and noise; identifies them on the way"
    is_told_ranges = True
    gate = 5.0  # standard deviations

    @property
    def ranges(self) -> np.ndarray:
        """Lowest and highest factor of stiffness and bars' mass, and payload [kg], (3, 2)."""
        drawn = self.core.randomization
        payload = getattr(self.core, "payload_range", None) or (self.nominal.design.payload,) * 2
        return np.array([drawn.stiffness or (1.0, 1.0), drawn.mass or (1.0, 1.0), payload], float)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> ServoMemory:
        """See `AnalyticController.initial`."""
        return super().initial(observed, index)._replace(belief=self.prior(len(index)))

    def prior(self, n: int) -> Belief:
        """What the ranges say of n arms."""
        ranges = self.ranges
        variance = np.maximum((ranges[:, 1] - ranges[:, 0]) ** 2 / 12, _KNOWN)
        return Belief(np.tile(ranges.mean(axis=1), (n, 1)), np.tile(np.diag(variance), (n, 1, 1)))

    def updated(self, belief: Belief, q: np.ndarray, observed: DecodedObservation, looks: int = 1) -> Belief:
        """What is believed after a measurement in q (n, 2) [rad], the mean of so many."""
        if self.control == "joint":
            return belief  # the stiffest tensions follow the joints there, and nothing has to be known of the arm
        columns, tensions, design = tuple(q.T), tuple(observed.tensions.T), self.nominal.design

        def gradient(stiffness: float, mass: float, payload: float) -> np.ndarray:
            rows = TwoX(_varied(design, stiffness, mass, payload)).energy_gradient(columns, tensions)
            return np.stack([np.broadcast_to(row, len(q)) for row in rows], axis=1)

        without = gradient(0.0, 0.0, 0.0)
        h = np.stack([gradient(*unit) - without for unit in np.eye(3)], axis=2)
        rows = self.nominal.stiffness_matrix(columns, tensions)
        k = np.stack([np.stack([np.broadcast_to(v, len(q)) for v in row], axis=1) for row in rows], axis=1)
        noise = k @ self._angle_covariance(columns, "joint_angles" in observed) @ k.transpose(0, 2, 1) / looks
        across = belief.covariance @ h.transpose(0, 2, 1)
        innovation = np.linalg.inv(h @ across + noise)
        off = (-without - (h @ belief.mean[..., None])[..., 0])[..., None]
        likely = (off.transpose(0, 2, 1) @ innovation @ off)[:, 0, 0] < self.gate**2
        gain = np.where(likely[:, None, None], across @ innovation, 0.0)
        mean = np.clip(belief.mean + (gain @ off)[..., 0], *self.ranges.T)
        covariance = belief.covariance - gain @ h @ belief.covariance
        return Belief(mean, (covariance + covariance.transpose(0, 2, 1)) / 2)

    def _angle_covariance(self, q: tuple[np.ndarray, ...], sees_angles: bool) -> np.ndarray:
        """Covariance of the measured joint angles [rad^2], (n, 2, 2)."""
        drawn, n = self.core.randomization, len(q[0])
        if sees_angles:
            return np.tile(max(drawn.angle_noise, _FLOOR) ** 2 * np.eye(2), (n, 1, 1))
        jacobian = jacobian_at(self.nominal, q)
        information = jacobian.transpose(0, 2, 1) @ jacobian / max(drawn.tip_noise, _FLOOR) ** 2
        return np.linalg.inv(information + np.eye(2))  # of a singular arm, a radian in the direction that is not seen


def _varied(design: TwoXDesign, stiffness: Component, mass: Component, payload: Component) -> TwoXDesign:
    """The design with these factors of stiffness and bars' mass, and this payload [kg]."""
    return replace(
        design,
        k1=design.k1 * stiffness,
        k2=design.k2 * stiffness,
        bar_density=design.bar_density * mass,
        payload=payload,
    )
