"""Planners of the 2-X in dynamics (`integral_ramp`): they keep off the edge of the feasible set, or identify the arm.

`RestingObserver` is told the mean tip of several looks at rest, tensions and, roughly, the joint angles: two steps of
Newton's method from these lead to the configuration of that tip. One measurement of `servo.IdentifyingObserver` there,
of the factors of stiffness and bars' mass and of the payload, from the documented ranges, tells the arm. Dry friction
holds the joints up to a torque that is not known, but much smaller than what the noise of one look comes to.
"""

from typing import Any

import numpy as np

from tensegrity_agents.controllers.two_x.reach import ClosedFormIK
from tensegrity_agents.controllers.two_x.servo import Belief, IdentifyingObserver
from tensegrity_agents.controllers.two_x.tracking import resolved_rate
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation

_STEPS, _DAMPING = 2, 0.02  # of Newton's method, [m/rad]


class CarefulClosedForm(ClosedFormIK):
    """The closed form by a path that keeps off the edge: the arm is not quite the one that is planned with."""

    clearance = 0.1


class RestingObserver(CarefulClosedForm):
    """Plans with the arm that looks at rest tell. See the module.

    Its memory's `payload` holds all that is believed, (n, 3).

    Args:
        core: of the environment, joint angles observed.
        looks: of which the tip is the mean.
    """

    knows = "the nominal design and the ranges of stiffness, mass and noise; identifies them at rest"
    is_told_ranges = True

    def __init__(self, core: Core, looks: int = 1) -> None:
        super().__init__(core)
        self.identifier, self.looks = IdentifyingObserver(core), looks

    def _believed(self, observed: DecodedObservation, index: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        q = observed.joint_angles
        for _ in range(_STEPS):
            off = observed.tip - np.stack(self.nominal.tip(tuple(q.T)), axis=1)
            q = q + resolved_rate(self.nominal, q, off, _DAMPING)
        belief = self.identifier.updated(self.identifier.prior(len(q)), q, observed, self.looks)
        return q, q, belief.mean

    def arm_with(self, payload: np.ndarray) -> Any:
        """See `ReachController.arm_with`."""
        return self.identifier.arm(Belief(payload, payload))
