"""Controllers of arms of X-joints among obstacles."""

import numpy as np

from tensegrity_agents.controllers import n_x
from tensegrity_agents.controllers.obstacles.clearing import Clearing, push_away
from tensegrity_agents.controllers.obstacles.planning import KEPT, PathPlanner
from tensegrity_envs.core import Core
from tensegrity_envs.mechanics.n_x.postures import postures_at
from tensegrity_envs.observation import DecodedObservation


class ClosedFormIK(n_x.ClosedFormIK):
    """As without obstacles: the inverse solution whose straight joint path stays feasible and is shortest."""

    knows = "the nominal design; takes no notice of the obstacles"


class PseudoInverse(n_x.PseudoInverse):
    """Resolved rate with the damped pseudo-inverse; the null space leads away from the nearest obstacle, and a step is
    cut short where it would touch one.
    """

    knows = "the nominal design and the obstacles; feedback of the tip error"
    near = 0.06  # of the reach: from there on the null space leads away from obstacles
    push = 0.08  # [rad] in a step, at an obstacle

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.clearing, self.reach = Clearing(core), core.reach

    def joint_step(self, observed: DecodedObservation, q: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """See `two_x.PseudoInverse.joint_step`.

        With c the clearance, the null space takes -centring q + push (1 - c / near) grad c / |grad c|.
        """
        discs = self.clearing.discs(observed)
        rest = -self.centring * q + push_away(self.clearing, q, discs, self.near * self.reach, self.push)
        step = self.in_null_space(q, wanted, rest, self.damping)
        return self.clearing.kept_off(q.T, step.T, discs, KEPT * self.reach).T


class Planner(n_x.ClosedFormIK):
    """Goes along a joint path that is free in the nominal model: straight to an inverse solution, or by a sampling
    planner.
    """

    knows = "the nominal design and the obstacles; plans a free joint path"

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.planner = PathPlanner(core)

    def _paths(self, model: object, start: np.ndarray, observed: DecodedObservation) -> list[np.ndarray]:
        owner, ends = postures_at(self.nominal, *observed.target.T)
        discs = self.planner.clearing.discs(observed).T
        paths = []
        for i, q in enumerate(start):
            found = self.planner.path(self.nominal, q, ends[:, owner == i].T, discs[i])
            paths.append(np.array(found or [q]))
        return paths
