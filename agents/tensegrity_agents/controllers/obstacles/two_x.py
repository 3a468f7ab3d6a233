"""Controllers of the 2-X among obstacles."""

import numpy as np

from tensegrity_agents.controllers import two_x
from tensegrity_agents.controllers.obstacles.clearing import KeepsOff
from tensegrity_agents.controllers.obstacles.planning import PlansFreePaths
from tensegrity_agents.controllers.two_x.measurements import solutions
from tensegrity_envs.observation import DecodedObservation


class ClosedFormIK(two_x.ClosedFormIK):
    """As without obstacles: the inverse solution whose straight joint path stays feasible and is shortest."""

    knows = "the nominal design; takes no notice of the obstacles"


class PseudoInverse(KeepsOff, two_x.PseudoInverse):
    """Resolved rate with the damped pseudo-inverse; a step is cut short where it would touch an obstacle.

    Two joints move two coordinates of the tip: there is no null space in which to keep off.
    """

    def joint_step(self, observed: DecodedObservation, q: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """See `two_x.PseudoInverse.joint_step`."""
        return self.kept_off(q, super().joint_step(observed, q, wanted), self.clearing.discs(observed))


class Planner(PlansFreePaths, two_x.ClosedFormIK):
    """Goes along a joint path that is free in the nominal model: straight to an inverse solution, or by a sampling
    planner.
    """

    def solutions_of(self, target: np.ndarray) -> list[np.ndarray]:
        """See `PlansFreePaths.solutions_of`."""
        table, missing = solutions(self.nominal, target)
        return [table[:, i, ~missing[i]].T for i in range(len(target))]
