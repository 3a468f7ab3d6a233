"""Controllers of arms of X-joints among obstacles."""

import numpy as np

from tensegrity_agents.controllers import n_x
from tensegrity_agents.controllers.obstacles.clearing import KeepsOff
from tensegrity_agents.controllers.obstacles.planning import PlansFreePaths
from tensegrity_envs.mechanics.n_x.postures import postures_at
from tensegrity_envs.observation import DecodedObservation


class ClosedFormIK(n_x.ClosedFormIK):
    """As without obstacles: the inverse solution whose straight joint path stays feasible and is shortest."""

    knows = "the nominal design; takes no notice of the obstacles"


class PseudoInverse(KeepsOff, n_x.PseudoInverse):
    """Resolved rate with the damped pseudo-inverse; the null space leads away from the nearest obstacle, and a step is
    cut short where it would touch one.
    """

    def joint_step(self, observed: DecodedObservation, q: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """See `two_x.PseudoInverse.joint_step`; the null space takes -centring q and what leads away."""
        discs = self.clearing.discs(observed)
        rest = -self.centring * q + self.push_away(q, discs)
        return self.kept_off(q, self.in_null_space(q, wanted, rest, self.damping), discs)


class Planner(PlansFreePaths, n_x.ClosedFormIK):
    """Goes along a joint path that is free in the nominal model: straight to an inverse solution, or by a sampling
    planner.
    """

    def solutions_of(self, target: np.ndarray) -> list[np.ndarray]:
        """See `PlansFreePaths.solutions_of`."""
        owner, ends = postures_at(self.nominal, *target.T)
        return [ends[:, owner == i].T for i in range(len(target))]
