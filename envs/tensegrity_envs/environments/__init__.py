"""The mechanisms as environments: how each is sampled, driven and seen."""

from tensegrity_envs.core import Core
from tensegrity_envs.environments.dual_triangle import DualTrianglePush, DualTriangleReach
from tensegrity_envs.environments.planar_four_bar import PlanarFourBarReach
from tensegrity_envs.environments.spatial_prism import SpatialPrismTrack
from tensegrity_envs.environments.two_x import TwoXPostureChange, TwoXReach
from tensegrity_envs.options import check_names

ARMS: dict[str, type[Core]] = {
    arm.__name__: arm
    for arm in (
        TwoXReach,
        DualTriangleReach,
        DualTrianglePush,
        TwoXPostureChange,
        PlanarFourBarReach,
        SpatialPrismTrack,
    )
}

__all__ = [
    "ARMS",
    "DualTrianglePush",
    "DualTriangleReach",
    "PlanarFourBarReach",
    "SpatialPrismTrack",
    "TwoXPostureChange",
    "TwoXReach",
    "core_of",
]


def core_of(arm: str | type[Core], options: dict[str, object]) -> Core:
    """The core of a name in ARMS, or of a class of your own.

    Raises:
        ValueError: there is no such name.
        TypeError: the core has no such argument.
    """
    if isinstance(arm, str):
        if arm not in ARMS:
            raise ValueError(f"arm = {arm!r}: must be one of {', '.join(map(repr, ARMS))}, or a subclass of Core")
        arm = ARMS[arm]
    check_names(arm, options)
    return arm(**options)
