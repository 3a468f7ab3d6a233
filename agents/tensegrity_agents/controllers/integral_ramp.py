"""A ramp along its own command, with slow integral action at rest: for arms that are not quite the nominal one.

As `dynamic.Ramp`, but the plan u*(k) is tracked by the controller's own command u, u <- clip(u + rate * action), so
that a delay only moves the same inputs to later steps. From `wait` steps after the end of the plan on, longer than the
delay, a torque t is added to what the inputs make, by least squares, beside what damps (`dynamic.Damped`):

    p = K dq,    dq = J^T (J J^T + d^2 I)^-1 (target - tip),
    t = share p + s,    s <- s + gain p,

with K the stiffness matrix of the nominal arm, where the command has it, its small eigenvalues raised to a twentieth of
the largest. The sum s removes what the nominal model does not know, grows until dry friction gives way, and averages
the noise; the share makes up for the time that damping takes where the arm is soft.

With `look` > 0 the inputs are held for so many steps first, and the plan is made with the mean of the tips until then:
for a base that identifies the arm from it.

An agent may correct either (`Correctable`): every action begins where the command has come to, so that nothing of what
is added stays.
"""

from typing import ClassVar, NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import jacobian_at
from tensegrity_agents.controllers.correctable import Correctable
from tensegrity_agents.controllers.dynamic import Base, Planned
from tensegrity_agents.controllers.fixed_length_damping import matrices
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation

_DAMPING = 0.1  # d [m/rad]
_NEAR = 0.1  # [m] of a correction
_SOFTEST = 0.05  # of the largest eigenvalue
_FAR, _SOON = 10.0, 20.0  # steps of the rate to the end of the plan, and of time, that are shown as 1


class IntegralMemory(NamedTuple):
    """What is carried from step to step, for n environments.

    Attributes:
        plan: inputs after each step, (n, steps, inputs).
        step: of the plan, (n,); negative while the controller looks.
        end: step from which on it rests, (n,).
        inputs: the command u, (n, inputs).
        torque: s, (n, joints) [N m].
        tips: sum of the tips while it looks, (n, 2) [m].
    """

    plan: np.ndarray
    step: np.ndarray
    end: np.ndarray
    inputs: np.ndarray
    torque: np.ndarray
    tips: np.ndarray


class IntegralRamp(Planned[IntegralMemory], Correctable[IntegralMemory]):
    """See the module.

    Args:
        core: of the environment, joint angles observed.
        base: makes the quasi-static controller.
        look: first steps, in which the inputs are held.
    """

    gain = 0.05
    share = 0.5
    wait = 5  # steps
    tunable: ClassVar[dict[str, tuple[float, ...]]] = {
        "gain": (0.03, 0.05),
        "share": (0.3, 0.5, 0.7),
        "shortest": (45, 60),
    }

    def __init__(self, core: Core, base: Base, look: int = 0) -> None:
        super().__init__(core, base, "smooth ramp along its own command, active damping, slow integral action at rest")
        self.look = look
        straight, least = np.zeros((1, self.joints)), np.full((1, self.core.simulation.action_size), self.low)
        self._scale = float(np.abs(self._effect(straight, least)).max() * self.rate * _FAR)  # [N m]

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> IntegralMemory:
        """See `AnalyticController.initial`."""
        n = len(index)
        plan = self._plan(observed, index)
        none = np.zeros((n, 2))
        return IntegralMemory(
            plan, np.full(n, -self.look), self._ends(plan), observed.inputs, np.zeros((n, self.joints)), none
        )

    def _act(self, observed: DecodedObservation, memory: IntegralMemory) -> tuple[np.ndarray, IntegralMemory]:
        if self.look:
            memory = self._looked(observed, memory)
        rows, step = np.arange(len(memory.step)), np.clip(memory.step, 0, memory.plan.shape[1] - 1)
        wanted = memory.plan[rows, step]
        own = observed.replace(inputs=memory.inputs)
        q = self.believed(own, wanted)
        rests = memory.step > memory.end + self.wait
        pull = np.where(rests[:, None], self._pull(own, q), 0.0)
        torque = memory.torque + self.gain * pull
        off = self.damping_torque(own, q) - torque - self.share * pull
        action = np.clip(self.resisting(own, wanted, q, off), -1.0, 1.0)
        action[memory.step < 0] = 0.0
        return action, memory._replace(step=memory.step + 1, inputs=self._driven(memory.inputs, action), torque=torque)

    def _driven(self, inputs: np.ndarray, action: np.ndarray) -> np.ndarray:
        """The command after an action."""
        return np.asarray(np.clip(inputs + self.rate * action, self.low, self.high))

    def given(self, before: IntegralMemory, after: IntegralMemory, action: np.ndarray) -> IntegralMemory:
        """See `Correctable.given`."""
        return after._replace(inputs=self._driven(before.inputs, action))

    def looks_at_rest(self, memory: IntegralMemory) -> np.ndarray:
        """See `Correctable.looks_at_rest`."""
        return np.asarray(memory.step <= 0)

    @property
    def outlook_size(self) -> int:
        """See `Correctable.outlook_size`."""
        return int(self.core.simulation.action_size) + self.joints + 1

    def outlook(self, observed: DecodedObservation, memory: IntegralMemory) -> np.ndarray:
        """See `Correctable.outlook`: the way to the end of the plan, the time until then, and the torque s, of which
        1 is what ten steps of one input make at q = 0.
        """
        way = (memory.plan[:, -1] - memory.inputs) / (_FAR * self.rate)
        time = np.clip((memory.end - memory.step) / _SOON, -1.0, 1.0)[:, None]
        return np.concatenate([way, time, memory.torque / self._scale], axis=1)

    def _looked(self, observed: DecodedObservation, memory: IntegralMemory) -> IntegralMemory:
        """The memory with one more tip; and with plans where it was the last one."""
        tips = memory.tips + np.where(memory.step[:, None] <= 0, observed.tip, 0.0)
        index = np.flatnonzero(memory.step == 0)
        if not len(index):
            return memory._replace(tips=tips)
        mean = tips[index] / (self.look + 1)
        plan, end = memory.plan.copy(), memory.end.copy()
        plan[index] = self._plan(observed.take(index).replace(tip=mean), index)
        end[index] = self._ends(plan[index])
        return memory._replace(tips=tips, plan=plan, end=end)

    def _pull(self, observed: DecodedObservation, q: np.ndarray) -> np.ndarray:
        """p in configurations (n, joints) [rad], (n, joints) [N m]; of errors beyond 0.1 m as if they were that."""
        arm = self.core.nominal
        error = observed.target - observed.tip
        error = error * np.minimum(1.0, _NEAR / np.maximum(np.hypot(*error.T)[:, None], 1e-12))
        jacobian = jacobian_at(arm, tuple(q.T))
        square = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING**2 * np.eye(2)
        step = np.einsum("nij,nik,nk->nj", jacobian, np.linalg.inv(square), error)
        actuation = self.simulation.actuation(arm, tuple(observed.inputs.T))
        values, vectors = np.linalg.eigh(matrices(arm.stiffness_matrix(tuple(q.T), actuation), len(q)))
        values = np.maximum(values, _SOFTEST * values[:, -1:])
        return np.asarray(np.einsum("nij,nj,nkj,nk->ni", vectors, values, vectors, step))
