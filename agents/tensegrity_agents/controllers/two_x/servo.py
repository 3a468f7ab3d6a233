"""Controllers of the 2-X for an arm that is not quite the nominal one, behind a delay, seen through noise.

The servo plans a joint path, straight or around what is infeasible, and sends the stiffest tensions along it as
feedforward. It tracks its own command u,

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
believed to be in that step. In cable control the inputs are held for `looks` steps first, and the path is planned with
what is believed then.

An agent may correct either (`Correctable`): what it has added to the tensions stays added to all that follow; in joint
control the way to the next waypoint goes on from where the joints are.
"""

from dataclasses import replace
from typing import ClassVar, NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import jacobian_at, ragged, rows_of, rows_where, with_rows
from tensegrity_agents.controllers.correctable import Correctable
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
_FAR, _OFF, _SOON = 0.5, 0.1, 20.0  # [rad] of the way, [rad] off it, and steps at its end, that are shown as 1


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
        added: what an agent has added to it, (n, 4) [N].
        looks: steps for which the inputs are still held, (n,).
        seen: mean tip of those that are over, (n, 2) [m].
        rested: steps since the command came to the end of the path, (n,).
        belief: about the arms.
    """

    plan: Memory
    inputs: np.ndarray
    added: np.ndarray
    looks: np.ndarray
    seen: np.ndarray
    rested: np.ndarray
    belief: Belief


class Servo(Correctable[ServoMemory]):
    """Planned path, feedforward along its own command, slow integral after a wait. See the module.

    Args:
        core: of the environment.
        looks: steps for which the inputs are held at first, in cable control.
        clearance: of paths [-]: the arm is not quite the one that is planned with.
    """

    knows = "the nominal design; its own commands; feedback of the tip error at rest"
    gain = 0.15
    wait = 4  # steps
    damping = 0.1  # d [m/rad]
    near = 0.03  # [rad]: so near to its end the path is over
    tunable: ClassVar[dict[str, tuple[float, ...]]] = {
        "gain": (0.05, 0.1, 0.15, 0.25),
        "wait": (2, 4, 8),
        "damping": (0.02, 0.05, 0.1),
    }
    nominal: TwoX

    def __init__(self, core: Core, looks: int = 0, clearance: float = 0.1) -> None:
        super().__init__(core)
        self.control = core.control
        self.clearance = clearance
        self.looks = looks if self.control == "tension" else 0
        self.planner = Observer(core)

    def _take(self, design: TwoXDesign) -> None:
        super()._take(design)
        if hasattr(self, "planner"):
            self.planner.begin_episodes(np.ones(1, bool), design)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> ServoMemory:
        """See `AnalyticController.initial`."""
        n, inputs = len(index), observed.tensions
        plan, looks = self.planner.at_rest(observed, index), np.full(n, self.looks)
        belief, none = self.first_belief(plan.payload), np.zeros_like(inputs)
        memory = ServoMemory(plan, inputs, none, looks, np.zeros_like(observed.tip), np.zeros(n, int), belief)
        return memory if self.looks else self._planned(memory, self.planner.arm_with(plan.payload), observed.target)

    def first_belief(self, payload: np.ndarray) -> Belief:
        """What is believed of n arms before anything was measured but payloads (n,) [kg]."""
        ones = np.ones_like(payload)
        return Belief(np.stack([ones, ones, payload], axis=1), np.zeros((len(payload), 3, 3)))

    def _planned(self, memory: ServoMemory, arm: TwoX, target: np.ndarray) -> ServoMemory:
        """The memory with paths of these arms to targets (n, 2) [m]."""
        self.planner.clearance = self.clearance
        paths = self.planner.paths_around(arm, memory.plan.commanded, target)
        return memory._replace(plan=memory.plan._replace(path=ragged(paths), leg=np.zeros(len(paths), int)))

    def _act(self, observed: DecodedObservation, memory: ServoMemory) -> tuple[np.ndarray, ServoMemory]:
        looks = memory.looks > 0
        if not looks.any():
            return self._followed(observed, memory)
        over = self.looks - memory.looks
        seen = memory.seen + (observed.tip - memory.seen) / (over + 1)[:, None]
        left = np.maximum(memory.looks - 1, 0)
        memory = memory._replace(seen=np.where(looks[:, None], seen, memory.seen), looks=left)
        has_looked = np.flatnonzero(looks & (left == 0))
        if len(has_looked):
            ready = self._looked(rows_of(memory, has_looked), observed.take(has_looked))
            memory = with_rows(memory, has_looked, ready)
        action, after = self._followed(observed, memory)
        looks = left > 0
        return np.where(looks[:, None], 0.0, action), rows_where(looks, memory, after)

    def _looked(self, memory: ServoMemory, observed: DecodedObservation) -> ServoMemory:
        """The memory of those that have looked, with what the mean of the tips tells, and a path."""
        observed = observed.replace(tip=memory.seen)
        q = configuration_from_tip(self.nominal, observed, None)
        belief = self.updated(memory.belief, q, observed, self.looks)
        arm = self.arm(belief)
        rest = arm.equilibrium(tuple(observed.tensions.T), tuple(q.T))
        commanded = np.where(np.asarray(rest.is_stable)[:, None], np.stack(rest.configuration, axis=1), q)
        plan = memory.plan._replace(configuration=q, commanded=commanded)
        return self._planned(memory._replace(plan=plan, belief=belief), arm, observed.target)

    def _followed(self, observed: DecodedObservation, memory: ServoMemory) -> tuple[np.ndarray, ServoMemory]:
        """Actions along the path, and what to remember."""
        limit = self.nominal.design.joint_limit
        q = configuration_from_tip(self.nominal, observed, memory.plan.configuration)
        belief = self.updated(memory.belief, q, observed)
        waypoint, plan = self.planner.next_waypoint(memory.plan.commanded, memory.plan._replace(configuration=q))
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
            commanded = self._moved(plan.commanded, action)
        else:
            without = memory.inputs - memory.added
            action, commanded = tension_action(self.arm(belief), plan.commanded, goal, without)
            inputs = self._driven(memory.inputs, action)
        plan = plan._replace(commanded=commanded, integral=correction)
        return action, memory._replace(plan=plan, inputs=inputs, rested=rested, belief=belief)

    def _moved(self, commanded: np.ndarray, action: np.ndarray) -> np.ndarray:
        """Joint angles (n, joints) [rad] that are commanded after actions."""
        return np.asarray(commanded + self.rate * np.clip(action, -1.0, 1.0))

    def _driven(self, inputs: np.ndarray, action: np.ndarray) -> np.ndarray:
        """Tensions (n, 4) [N] that are commanded after actions."""
        design = self.nominal.design
        driven = inputs + TensionControl.rate * np.clip(action, -1.0, 1.0)
        return np.asarray(np.clip(driven, design.min_tension, design.max_tension))

    def given(self, before: ServoMemory, after: ServoMemory, action: np.ndarray) -> ServoMemory:
        """See `Correctable.given`."""
        if self.control == "joint":
            return after._replace(plan=after.plan._replace(commanded=self._moved(before.plan.commanded, action)))
        inputs = self._driven(before.inputs, action)
        return after._replace(inputs=inputs, added=after.added + inputs - after.inputs)

    def added(self, memory: ServoMemory) -> np.ndarray:
        """See `Correctable.added`."""
        return np.zeros_like(memory.plan.commanded) if self.control == "joint" else memory.added / TensionControl.rate

    def looks_at_rest(self, memory: ServoMemory) -> np.ndarray:
        """See `Correctable.looks_at_rest`."""
        return np.asarray(memory.looks > 0)

    @property
    def outlook_size(self) -> int:
        """See `Correctable.outlook_size`."""
        return 2 * self.nominal.degrees_of_freedom + 2

    def outlook(self, observed: DecodedObservation, memory: ServoMemory) -> np.ndarray:
        """See `Correctable.outlook`: the way to the end of the path, how far the arm is off it, whether the inputs are
        held, and how long it has been at the end.
        """
        plan = memory.plan
        way = (np.stack([path[-1] for path in plan.path]) + plan.integral - plan.commanded) / _FAR
        off = (plan.configuration - plan.commanded) / _OFF
        times = np.stack([memory.looks > 0, memory.rested / _SOON], axis=1)
        return np.concatenate([way, off, times], axis=1)

    def updated(self, belief: Belief, q: np.ndarray, observed: DecodedObservation, looks: int = 1) -> Belief:
        """What is believed after a measurement, the mean of so many; here always the same."""
        return belief

    def arm(self, belief: Belief) -> TwoX:
        """The arms as they are believed to be."""
        stiffness, mass, payload = belief.mean.T
        return TwoX(_varied(self.nominal.design, stiffness, mass, payload))


class IdentifyingObserver(Servo):
    """A servo that identifies stiffness, mass and payload on the way, by recursive least squares. See the module.

    Args:
        core: of the environment.
        looks: steps for which the inputs are held at first, in cable control and where the tip is seen through noise.
        clearance: see `Servo`.
    """

    knows = "the nominal design and the ranges of stiffness, mass, payload and noise; identifies them on the way"
    is_told_ranges = True
    gate = 5.0  # standard deviations
    tunable: ClassVar[dict[str, tuple[float, ...]]] = {
        "looks": (0, 4, 8, 12, 16),
        "clearance": (0.1, 0.2, 0.3),
        "gain": (0.1, 0.15, 0.25),
    }

    def __init__(self, core: Core, looks: int = 0, clearance: float = 0.1) -> None:
        super().__init__(core, looks if core.randomization.tip_noise else 0, clearance)

    @property
    def ranges(self) -> np.ndarray:
        """Lowest and highest factor of stiffness and bars' mass, and payload [kg], (3, 2)."""
        drawn = self.core.randomization
        payload = getattr(self.core, "payload_range", None) or (self.nominal.design.payload,) * 2
        return np.array([drawn.stiffness or (1.0, 1.0), drawn.mass or (1.0, 1.0), payload], float)

    def first_belief(self, payload: np.ndarray) -> Belief:
        """See `Servo.first_belief`: the ranges tell more than one measurement does."""
        return self.prior(len(payload))

    @property
    def outlook_size(self) -> int:
        """See `Correctable.outlook_size`."""
        return super().outlook_size + 6

    def outlook(self, observed: DecodedObservation, memory: ServoMemory) -> np.ndarray:
        """See `Servo.outlook`; and what is believed, and how surely, in half widths of the ranges."""
        low, high = self.ranges.T
        half = np.maximum((high - low) / 2, np.sqrt(_KNOWN))
        sure = np.sqrt(np.maximum(np.diagonal(memory.belief.covariance, axis1=1, axis2=2), 0.0)) / half
        return np.concatenate(
            [super().outlook(observed, memory), (memory.belief.mean - (low + high) / 2) / half, sure], 1
        )

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
