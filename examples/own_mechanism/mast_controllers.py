"""Analytic controllers of the mast."""

from typing import Any, NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController
from tensegrity_envs.observation import DecodedObservation


class Target(NamedTuple):
    """What is remembered of an episode: the tensions to reach, shape (n, 2) [N]."""

    tensions: np.ndarray


class ClosedFormIK(AnalyticController[Target]):
    """Goes to the tensions that, as the nominal model says, hold an inverse solution within the joint limits."""

    knows = "the nominal design"

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> Target:
        """See `AnalyticController.initial`."""
        limit = self.nominal.design.joint_limit
        one, other = (np.stack(q) for q in self.nominal.inverse_configurations(*observed.target.T))
        q = np.where((np.abs(one).max(axis=0) <= limit)[None], one, other)  # that of the target is one of them
        tensions = np.stack(self.nominal.holding_tensions(tuple(q)), axis=1)
        return Target(np.clip(np.nan_to_num(tensions), *self.input_bounds()))

    def _act(self, observed: DecodedObservation, memory: Target) -> tuple[np.ndarray, Target]:
        return (memory.tensions - observed.inputs) / self.rate, memory


class PseudoInverse(AnalyticController[tuple[Any, ...]]):
    """Feedback: moves the tip by damped least squares, and the tensions by what the stiffness matrix then asks for."""

    knows = "the nominal design; measures tip and joint angles"
    gain = 0.5
    damping = 0.05  # [m]

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> tuple[Any, ...]:
        """Nothing is remembered."""
        return ()

    def _act(self, observed: DecodedObservation, memory: tuple[Any, ...]) -> tuple[np.ndarray, tuple[Any, ...]]:
        if "joint_angles" in observed:
            q = tuple(observed.joint_angles.T)
        else:
            q, _ = self.nominal.inverse_configurations(*observed.tip.T)
            q = tuple(np.nan_to_num(angle) for angle in q)
        tensions = tuple(observed.inputs.T)
        jacobian = np.moveaxis(np.array(self.nominal.jacobian(q)), 2, 0)
        stiffness = np.moveaxis(np.array(self.nominal.stiffness_matrix(q, tensions)), 2, 0)
        across = jacobian @ jacobian.transpose(0, 2, 1) + self.damping**2 * np.eye(2)
        error = (observed.target - observed.tip)[:, :, None]
        turn = jacobian.transpose(0, 2, 1) @ np.linalg.solve(across, self.gain * error)
        # d (gradient) = stiffness turn + lever d (tensions) = 0
        lever = np.stack([self.nominal.lever(angle) for angle in q], axis=1)
        return -(stiffness @ turn)[:, :, 0] / lever / self.rate, memory
