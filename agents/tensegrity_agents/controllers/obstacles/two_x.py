"""Controllers of the 2-X among obstacles."""

import numpy as np

from tensegrity_agents.controllers import two_x
from tensegrity_agents.controllers.obstacles.planning import PathPlanner
from tensegrity_agents.controllers.two_x.reading import solutions
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation


class ClosedFormIK(two_x.ClosedFormIK):
    """As without obstacles: the inverse solution whose straight joint path stays feasible and is shortest."""

    knows = "the nominal design; takes no notice of the obstacles"


class Planner(two_x.ClosedFormIK):
    """Goes along a joint path that is free in the nominal model: straight to an inverse solution, or by a sampling
    planner.
    """

    knows = "the nominal design and the obstacles; plans a free joint path"

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.planner = PathPlanner(core)

    def _paths(self, model: object, start: np.ndarray, observed: DecodedObservation) -> list[np.ndarray]:
        table, missing = solutions(self.nominal, observed.target)
        discs = self.planner.clearing.discs(observed).T
        paths = []
        for i, q in enumerate(start):
            found = self.planner.path(self.nominal, q, table[:, i, ~missing[i]].T, discs[i])
            paths.append(np.array(found or [q]))
        return paths
