"""The planar 4-bar mechanism, told everything: what a controller could do that lacks nothing but time.

It is told the force and the drawn stiffness, and configurations depend on their ratio alone: it plans in the nominal
model with the force divided by the stiffness factor. Lengths are measured without noise and, with that force, tell
where the mechanism rests. The delay is known, and there is nothing to be done about it but to send the same inputs: it
follows its own command, which a delay only moves to later steps.
"""

import numpy as np

from tensegrity_agents.controllers.planar_four_bar.reach import Memory, Observer
from tensegrity_agents.controllers.planar_four_bar.servo import Replanning
from tensegrity_envs.observation import DecodedObservation


class _Told(Observer):
    """Plans with the true ratio of force and stiffness."""

    wants_privileged = True

    def load(self, observed: DecodedObservation, memory: Memory) -> np.ndarray:
        """See `ReachController.load`."""
        n = len(observed)
        factor = np.broadcast_to(self.truth.design.stiffness / float(self.nominal.stiffness), n)
        return np.asarray(self.true_load(np.arange(n)) / factor[:, None])


class Informed(Replanning):
    """Plans in the true model and follows its own command. See the module.

    Args:
        core: of the environment.
    """

    wants_privileged = True
    knows = "everything that was drawn, the delay included, and the true state; plans in the true model"
    planner_class = _Told
