"""The spatial prism, told everything: what a controller could do that lacks nothing.

It is told the drawn stiffness, the payload and its moment, the delay and the curve. Lengths and load fix where the
platform is, so nothing has to be measured: it sends the lengths that hold the goal of the step in which they will act,
under the load of then.
"""

import numpy as np

from tensegrity_agents.controllers.spatial_prism.servo import Ahead, ServoMemory
from tensegrity_agents.controllers.spatial_prism.track import held


class Informed(Ahead):
    """The loaded inverse kinematics in the true model, ahead by the true delay. See the module.

    Args:
        core: of the environment.
    """

    wants_privileged = True
    knows = "everything that was drawn, the delay included; loaded inverse kinematics in the true model"

    def _delay(self, memory: ServoMemory) -> np.ndarray:
        delay = self.truth.random.get("actuation_delay", 0)
        return np.broadcast_to(np.asarray(delay, int), memory.step.shape)

    def _lengths(self, goal: np.ndarray, time: np.ndarray, memory: ServoMemory) -> np.ndarray:
        then = time.astype(float)
        weight = -np.asarray(self.truth.load_at(then)[2], float)
        # Poses depend on weight and stiffness by their ratio alone.
        ratio = weight * float(self.nominal.design.k) / self.truth.design.k
        return held(self.nominal, np.stack(self.truth.goal_at(then), axis=1), ratio)
