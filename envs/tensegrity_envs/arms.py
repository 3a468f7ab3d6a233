"""The former name of `tensegrity_envs.environments`, kept for those who import from here."""

from tensegrity_envs.environments import (
    ARMS,
    DualTrianglePush,
    DualTriangleReach,
    PlanarFourBarReach,
    SpatialPrismTrack,
    TwoXPostureChange,
    TwoXReach,
    core_of,
)

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
