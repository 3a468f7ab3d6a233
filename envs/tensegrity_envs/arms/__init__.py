"""The mechanisms as environments: how each is drawn, driven and seen."""

from tensegrity_envs.arms.dual_triangle import DualTrianglePush, DualTriangleReach
from tensegrity_envs.arms.planar_four_bar import PlanarFourBarReach
from tensegrity_envs.arms.spatial_prism import SpatialPrismTrack
from tensegrity_envs.arms.two_x import TwoXReach
from tensegrity_envs.arms.two_x_posture import TwoXPostureChange
from tensegrity_envs.core import Core

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
    """
    if isinstance(arm, str):
        if arm not in ARMS:
            raise ValueError(f"arm = {arm!r}: must be one of {', '.join(map(repr, ARMS))}, or a subclass of Core")
        arm = ARMS[arm]
    return arm(**options)
