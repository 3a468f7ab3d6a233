"""What the resolution of an arm's redundancy answers."""

import math
from typing import NamedTuple

from tensegrity_envs.compiler.namespace import Component, Components


class Redundancy(NamedTuple):
    """The best configuration of a target.

    Attributes:
        configuration: n angles [rad], NaN where the target is not reached.
        objective: its value, see `Optimum`; NaN where the target is not reached.
        is_reachable: whether a configuration within the joint limits has its tip there.
        stability_margin: of the configuration at its stiffest tensions under the load, see `NX.stability_margin`.
        wrench_margin: of the configuration under the load, see `NX.wrench_margin`; negative where no tensions hold it.
    """

    configuration: Components
    objective: Component
    is_reachable: Component
    stability_margin: Component = math.nan
    wrench_margin: Component = math.nan

    @property
    def is_stable_wrench_feasible(self) -> Component:
        """Whether feasible tensions hold the configuration in stable equilibrium; False where there is none."""
        return (self.stability_margin > 0) & (self.wrench_margin >= 0)
