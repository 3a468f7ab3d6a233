"""Where a 2-X can be, for reports."""

from typing import Any

from tensegrity_envs.mechanics.two_x import TwoX


class TwoXRegions:
    """What the environments of the 2-X answer when a report asks where it can be."""

    shows_joint_space = True
    nominal: TwoX

    def tip_region(self) -> Any:
        """The stable wrench-feasible workspace, with its exact boundary; see `Core.tip_region`."""
        from tensegrity_envs.geometry.workspace import stable_wrench_feasible_workspace  # loads Shapely

        return stable_wrench_feasible_workspace(self.nominal).reachable
