"""What model-predictive control believes of a dual-triangle arm: the load, as the mean of what explains the tips.

A wrong stiffness is told as a load that has the same effect where the arm is (see `servo`), so later explanations weigh
more: load <- load + `_WEIGHT` (explained - load).
"""

from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.dual_triangle.identification import explain
from tensegrity_agents.controllers.dual_triangle.reach import Observer
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation import Episode

_WEIGHT = 0.1


class Believed(NamedTuple):
    """Loads (n, 2) [N], and the latest configurations (n, 3) [rad]."""

    load: np.ndarray
    configuration: np.ndarray


class DualTriangleBeliefs:
    """See `mpc.Beliefs`.

    Args:
        core: of the environment.
    """

    def __init__(self, core: Core) -> None:
        self.arm = Observer(core).nominal

    def first(self, observed: DecodedObservation) -> Believed:
        """See `mpc.Beliefs`."""
        found = explain(self.arm, observed.tip, np.stack(self.arm.free_lengths(tuple(observed.inputs.T)), axis=1))
        return Believed(found.load, found.configuration)

    def updated(self, belief: Believed, observed: DecodedObservation) -> Believed:
        """See `mpc.Beliefs`."""
        found = explain(self.arm, observed.tip, np.stack(self.arm.free_lengths(tuple(observed.inputs.T)), axis=1))
        fits = found.explanations > 0
        load = np.where(fits[:, None], belief.load + _WEIGHT * (found.load - belief.load), belief.load)
        return Believed(load, np.where(fits[:, None], found.configuration, belief.configuration))

    def told(self, belief: Believed) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """See `mpc.Beliefs`."""
        return belief.configuration, {"load": belief.load}

    def goals(self, belief: Believed, episode: Episode) -> np.ndarray:
        """See `mpc.Beliefs`: none, the samples find the way."""
        return np.zeros((0, len(belief.load), 3))
