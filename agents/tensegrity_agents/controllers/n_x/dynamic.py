"""Ramps of arms of three X-joints or more in dynamics, which are too soft to be led by tensions alone."""

from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.dynamic import Base, Planned
from tensegrity_agents.controllers.resting import planned_at
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation


class HeldMemory(NamedTuple):
    """What a held ramp carries from step to step.

    Attributes:
        plan: inputs after each step, shape (n, steps, inputs).
        step: of the episode, shape (n,).
        posture: where the nominal arm rests under the planned inputs of this step, shape (n, joints) [rad].
    """

    plan: np.ndarray
    step: np.ndarray
    posture: np.ndarray


class HeldRamp(Planned[HeldMemory]):
    """The plan is followed smoothly, and feedback of the joint angles holds the arm on the postures of the plan.

    Tensions alone leave an arm of three X-joints with directions in which it is so soft that, damped, it creeps for
    seconds or, pushed by its own motion, falls into another equilibrium. To the planned tensions is added what gives
    the joint torques -M(q) (c velocity + s (q - posture)), M being the nominal arm's mass matrix. Where joint angles
    are not observed it is damped only.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
    """

    damping = 8.0  # c [1/s]
    stiffness = 25.0  # s [1/s2]

    def __init__(self, core: Core, base: Base) -> None:
        super().__init__(core, base, "smooth ramp, held on its postures by feedback of the joint angles")

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> HeldMemory:
        """See `AnalyticController.initial`."""
        plan = self._plan(observed, index)
        return HeldMemory(plan, np.zeros(len(index), int), self.believed(observed, observed.inputs))

    def _act(self, observed: DecodedObservation, memory: HeldMemory) -> tuple[np.ndarray, HeldMemory]:
        wanted = planned_at(memory.plan, memory.step)
        memory = memory._replace(step=memory.step + 1)
        if "joint_angles" not in observed:
            return self.damped(observed, wanted, self.believed(observed, wanted)), memory
        rest = self.core.nominal.equilibrium(tuple(wanted.T), tuple(memory.posture.T))
        stays = np.asarray(rest.is_stable)[:, None]
        posture = np.where(stays, np.stack(rest.configuration, axis=1), memory.posture)
        q = observed.joint_angles
        torque = self.damping * observed.joint_rates + self.stiffness * (q - posture)
        torque = np.einsum("nij,nj->ni", self._masses(q), torque)
        return self.resisting(observed, wanted, q, torque), memory._replace(posture=posture)

    def _masses(self, q: np.ndarray) -> np.ndarray:
        """Mass matrices (n, joints, joints) [kg m2] of the nominal arm."""
        limit = float(self.core.nominal.design.joint_limit)
        return np.stack([self.model.mass_matrix(one) for one in np.clip(q, -limit, limit)])
