"""What the analytic controllers share."""

from typing import Any

import numpy as np

from tensegrity_envs.core import Core
from tensegrity_envs.simulation import Episode


class AnalyticController:
    """Knows the core of its environment and the nominal mechanism; oracles are told the true episodes as well.

    Args:
        core: of the environment.

    Attributes:
        knows: what it is told and measures, for tables.
        rate: largest change of an input in one step.
        nominal: the mechanism of the nominal design.
        privileged: the true episodes, for those that ask for them (see `privileged.Privileged`).
    """

    wants_privileged = False
    knows = ""

    def __init__(self, core: Core) -> None:
        self.core = core
        self.rate = core.simulation.rate
        self.privileged: Episode | None = None
        self._take(core.design)

    def begin_episodes(self, mask: np.ndarray, design: Any, privileged: Episode | None = None) -> None:
        """Take the nominal design and, if this controller asks for it, the true episodes."""
        self._take(design)
        self.privileged = privileged

    def _take(self, design: Any) -> None:
        """Take the nominal design."""
        self.nominal: Any = self.core.mechanism(design)
