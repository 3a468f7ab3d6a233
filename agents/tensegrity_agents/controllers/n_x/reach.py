"""The analytic controllers that reach with an n-X arm: those of the 2-X, with a continuum of solutions."""

import numpy as np

from tensegrity_agents.controllers import two_x
from tensegrity_agents.controllers.base import jacobian_at
from tensegrity_agents.controllers.connecting import connect
from tensegrity_agents.controllers.n_x.measurements import configuration_of, estimate_payload
from tensegrity_agents.controllers.n_x.planning import choose_posture
from tensegrity_agents.controllers.two_x.measurements import Estimate
from tensegrity_agents.controllers.two_x.planning import margin
from tensegrity_envs.mechanics import NX
from tensegrity_envs.mechanics.n_x.postures import postures_at
from tensegrity_envs.observation import DecodedObservation

_LEAST = 0.005  # [-] margin along a planned path


class NXArm:
    """What the controllers of the 2-X ask of its model, for n joints."""

    nominal: NX
    clearance = 0.1  # [-] of straight paths, worth a longer one
    centring = 0.02  # share of the joint angles that the null space takes back in a step

    def configuration_of(self, observed: DecodedObservation, near: np.ndarray | None) -> np.ndarray:
        """See `measurements.configuration_of`."""
        return configuration_of(self.nominal, observed, near)

    def choose(self, model: NX, start: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `planning.choose_posture`."""
        return choose_posture(model, start, target, self.clearance)

    def around(self, model: NX, start: np.ndarray, target: np.ndarray) -> list[np.ndarray]:
        """A path by a sampling planner; see `connecting.connect`."""
        _, ends = postures_at(model, target[:1], target[1:])
        ends = ends[:, np.flatnonzero(margin(model, ends) > _LEAST)]

        def is_free(q: np.ndarray) -> np.ndarray:
            return np.asarray(margin(model, q) > _LEAST)

        return connect(is_free, start, ends.T, float(model.design.joint_limit))

    def resolved_rate(self, q: np.ndarray, wanted: np.ndarray, damping: float) -> np.ndarray:
        """Joint steps (n, joints) [rad] for wanted tip steps (n, 2) [m], with the null space led towards upright."""
        return self.in_null_space(q, wanted, -self.centring * q, damping)

    def in_null_space(self, q: np.ndarray, wanted: np.ndarray, rest: np.ndarray, damping: float) -> np.ndarray:
        """Joint steps (n, joints) [rad] for wanted tip steps (n, 2) [m], with others in the null space.

        With J+ = J^T (J J^T + d^2 I)^-1, the steps are J+ wanted + (I - J+ J) rest.
        """
        jacobian = jacobian_at(self.nominal, tuple(q.T))
        across = jacobian @ jacobian.transpose(0, 2, 1) + damping**2 * np.eye(2)
        more = wanted - (jacobian @ rest[..., None])[..., 0]
        step = jacobian.transpose(0, 2, 1) @ np.linalg.solve(across, more[..., None])
        return np.asarray(step[..., 0] + rest)

    def estimate(self, observed: DecodedObservation) -> Estimate:
        """See `measurements.estimate_payload`."""
        return estimate_payload(self.nominal, observed)


class ClosedFormIK(NXArm, two_x.ClosedFormIK):
    """Of many inverse solutions the one whose straight joint path stays feasible and is shortest; then straight there.

    In cable control, the stiffest tensions of the *nominal* arm along the path.
    """


class PseudoInverse(NXArm, two_x.PseudoInverse):
    """Resolved rate with the damped pseudo-inverse, integral action, and a null space that leads towards upright."""


class Observer(NXArm, two_x.Observer):
    """Solves payload and configuration from tip and tensions, then inverse kinematics for that payload."""


class Oracle(NXArm, two_x.Oracle):
    """Is given the true payload; where no straight joint path is feasible, a sampling planner finds one around."""
