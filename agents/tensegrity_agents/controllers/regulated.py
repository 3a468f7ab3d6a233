"""Full-speed plans for arms that vibrate: shaped for the modes at the target, and regulated about where they rest.

The inputs that a quasi-static controller would give at full speed (the rate of the inputs is the limit: a time-optimal
path of the inputs) are planned when an episode begins. `Shaped` sends them through an input shaper for the modes of the
arm linearised at the target, and then only adds the active damping of the ramps, if any. `Regulated` follows them with
the discrete linear-quadratic regulator

    u = u_plan - G (x - x_plan),    x = (q, dq/dt, what the actuators have reached),

about the equilibria x_plan through which the nominal arm would go at rest. Its gain G minimizes the sum of

    dq . K dq + dv . M dv + price |du|^2

in the motion linearised at the target (`simulation.mujoco.linearizing`), K being the stiffness matrix there and M the
mass matrix: the energy that is to be taken out. The price is `softness` times what the stiffness costs in a turn of
0.02 rad of every joint, for inputs that are off by their rate.
"""

from typing import ClassVar, NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, solve_discrete_are

from tensegrity_agents.controllers.base import Observation
from tensegrity_agents.controllers.dynamic import Base, Memory, Planned, RampMemory
from tensegrity_agents.controllers.input_shaping import Shaper, shaped, vibration_of
from tensegrity_agents.controllers.resting import planned_at
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation.mujoco.linearizing import LinearMotion, linearize

_TURN = 0.02  # [rad]
_FARTHEST = 0.5  # [rad]: an equilibrium that is farther from the one of the step before is another one


class FullSpeed(Planned[Memory]):
    """What both share: the plan, where the nominal arm rests under it, and its motion about the end."""

    shaper: Shaper | None = "ZV"

    def __init__(self, core: Core, base: Base, adds: str) -> None:
        super().__init__(core, base, adds)
        self.pace = "full"

    def plan_for(self, observation: Observation) -> np.ndarray:
        """Inputs after each step of episodes that begin with these observations, shape (n, steps, inputs)."""
        observed = self.decode(observation)
        return self._plan(observed, np.arange(len(observed)))

    def _prepared(
        self, observed: DecodedObservation, index: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, list[LinearMotion]]:
        """Inputs after each step (n, steps, inputs), configurations at rest (n, steps, joints), motions at the end."""
        plan = self._plan(observed, index)
        start = observed.joint_angles
        goal = self._rests(start, plan)[:, -1]
        motions = [linearize(self.model, q, u) for q, u in zip(goal, self._actuation(plan[:, -1]), strict=True)]
        if self.shaper is not None:
            vibration = vibration_of(np.stack([motion.a for motion in motions]), self.joints)
            plan = shaped(observed.inputs, plan, vibration, self.shaper)
        return plan, self._rests(start, plan), motions

    def _actuation(self, inputs: np.ndarray) -> np.ndarray:
        """What the actuators of n arms do, shape (n, actuators)."""
        return np.stack(self.simulation.actuation(self.core.nominal, tuple(inputs.T)), axis=1)

    def _rests(self, start: np.ndarray, plan: np.ndarray) -> np.ndarray:
        """Where the nominal arms would rest after each step, from `start` on, within the joint limits."""
        arm, limit = self.core.nominal, float(self.model.linkage.limit)
        q, found = np.clip(start, -limit, limit), []
        for k in range(plan.shape[1]):
            if k and np.array_equal(plan[:, k], plan[:, k - 1]):
                found.append(q)
                continue
            actuation = self.simulation.actuation(arm, tuple(plan[:, k].T))
            rest = np.stack(arm.equilibrium(actuation, tuple(np.ascontiguousarray(q.T))).configuration, axis=1)
            near = (np.abs(rest - q).max(axis=1) < _FARTHEST) & (np.abs(rest).max(axis=1) <= limit)  # NaN: no
            q = np.where(near[:, None], rest, q)
            found.append(q)
        return np.stack(found, axis=1)


class FullSpeedPlan(FullSpeed[RampMemory]):
    """The plan at full speed and nothing else: the inputs are there first, and the arm swings. Agents correct it.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
    """

    def __init__(self, core: Core, base: Base) -> None:
        super().__init__(core, base, "full speed")

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> RampMemory:
        """See `AnalyticController.initial`."""
        return RampMemory(self._plan(observed, index), np.zeros(len(index), int))

    def _act(self, observed: DecodedObservation, memory: RampMemory) -> tuple[np.ndarray, RampMemory]:
        action = np.clip(self.action_to(planned_at(memory.plan, memory.step), observed.inputs), -1.0, 1.0)
        return action, memory._replace(step=memory.step + 1)


class Shaped(FullSpeed[RampMemory]):
    """The plan at full speed through an input shaper for the modes at the target, with active damping. See the module.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
    """

    shaper: Shaper | None = "ZVD"

    def __init__(self, core: Core, base: Base) -> None:
        super().__init__(core, base, "full speed, shaped for the modes at the target, active damping")

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> RampMemory:
        """See `AnalyticController.initial`."""
        return RampMemory(self._prepared(observed, index)[0], np.zeros(len(index), int))

    def _act(self, observed: DecodedObservation, memory: RampMemory) -> tuple[np.ndarray, RampMemory]:
        return self.damped(observed, planned_at(memory.plan, memory.step), observed.joint_angles), memory._replace(
            step=memory.step + 1
        )


class RegulatedMemory(NamedTuple):
    """What a regulated plan carries from step to step.

    Attributes:
        plan: inputs after each step, shape (n, steps, inputs).
        rest: where the nominal arm would rest under them, shape (n, steps, joints) [rad].
        gain: of the regulator, shape (n, inputs, size of its state).
        reached: inputs that the lagging actuators have reached, by their nominal bandwidth, shape (n, inputs).
        step: of the episode, shape (n,).
    """

    plan: np.ndarray
    rest: np.ndarray
    gain: np.ndarray
    reached: np.ndarray
    step: np.ndarray


class Regulated(FullSpeed[RegulatedMemory]):
    """The plan at full speed, regulated about where the arm would rest. See the module.

    Args:
        core: of the environment, joint angles and rates observed.
        base: makes the quasi-static controller.
        shaper: see `input_shaping`; None for none.
        softness: see the module.
    """

    tunable: ClassVar[dict[str, tuple[float, ...]]] = {"softness": (0.3, 1.0, 3.0, 10.0, 30.0)}

    def __init__(self, core: Core, base: Base, shaper: Shaper | None = "ZV", softness: float = 1.0) -> None:
        super().__init__(core, base, "full speed, linear-quadratic regulator about the equilibria on the way")
        self.shaper, self.softness = shaper, softness
        dynamics = self.model.dynamics
        self.time = dynamics.step_time
        self.follows = float(1 - np.exp(-self.time / dynamics.time_constant)) if dynamics.time_constant else 1.0

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> RegulatedMemory:
        """See `AnalyticController.initial`."""
        plan, rest, motions = self._prepared(observed, index)
        ends = zip(motions, rest[:, -1], plan[:, -1], strict=True)
        gain = np.stack([self._gain(motion, q, u) for motion, q, u in ends])
        return RegulatedMemory(plan, rest, gain, observed.inputs, np.zeros(len(index), int))

    def _gain(self, motion: LinearMotion, q: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """The regulator of one arm, shape (inputs, size of its state); zero where there is none."""
        count, size, n = len(inputs), len(motion.a), self.joints
        rest = self._actuation(inputs[None])
        b = motion.b @ (self._actuation(inputs + np.eye(count)) - rest).T  # actuation is linear in the inputs
        rows = self.core.nominal.stiffness_matrix(tuple(q[:, None]), tuple(rest.T))
        stiffness = np.array([[np.ravel(value)[0] for value in row] for row in rows])
        values, vectors = np.linalg.eigh((stiffness + stiffness.T) / 2)
        stiffness = vectors @ np.diag(np.maximum(values, 1e-3 * np.abs(values).max())) @ vectors.T
        cost = np.zeros((size, size))
        cost[:n, :n], cost[n : 2 * n, n : 2 * n] = stiffness, self.model.mass_matrix(q)
        cost += 1e-9 * np.trace(cost) * np.eye(size)
        effort = self.softness * np.trace(stiffness) * _TURN**2 / self.rate**2 * np.eye(count)
        try:
            ahead = solve_discrete_are(motion.a, b, cost, effort)
        except (LinAlgError, ValueError):
            return np.zeros((count, size))
        return np.asarray(np.linalg.solve(effort + b.T @ ahead @ b, b.T @ ahead @ motion.a))

    def _act(self, observed: DecodedObservation, memory: RegulatedMemory) -> tuple[np.ndarray, RegulatedMemory]:
        rows, last = np.arange(len(memory.step)), memory.plan.shape[1] - 1
        step, before = np.minimum(memory.step, last), np.clip(memory.step - 1, 0, last)
        wanted, rest = memory.plan[rows, step], memory.rest[rows, before]
        rate = (memory.rest[rows, step] - rest) / self.time
        parts = [observed.joint_angles - rest, observed.joint_rates - rate]
        if self.model.model.na:
            parts.append(self._actuation(memory.reached) - self._actuation(memory.plan[rows, before]))
        inputs = wanted - np.einsum("nij,nj->ni", memory.gain, np.concatenate(parts, axis=1))
        action = np.clip(self.action_to(inputs, observed.inputs), -1.0, 1.0)
        commanded = np.clip(observed.inputs + self.rate * action, self.low, self.high)
        reached = memory.reached + self.follows * (commanded - memory.reached)
        return action, memory._replace(reached=reached, step=memory.step + 1)
