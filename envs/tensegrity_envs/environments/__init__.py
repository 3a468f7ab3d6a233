"""The mechanisms as environments: how each is sampled, driven and seen."""

import importlib
from typing import Any

from tensegrity_envs.core import Core
from tensegrity_envs.environments.dual_triangle import DualTrianglePush, DualTriangleReach
from tensegrity_envs.environments.fast import DualTriangleFastReach, TwoXFastReach
from tensegrity_envs.environments.n_x import NXReach
from tensegrity_envs.environments.obstacles import (
    DualTriangleObstacleReach,
    NXObstacleReach,
    PlanarFourBarObstacleReach,
    TwoXObstacleReach,
)
from tensegrity_envs.environments.planar_four_bar import PlanarFourBarReach
from tensegrity_envs.environments.spatial_prism import SpatialPrismTrack
from tensegrity_envs.environments.stiffness import NXStiffnessReach, TwoXStiffnessReach
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
        NXReach,
        TwoXFastReach,
        DualTriangleFastReach,
        TwoXStiffnessReach,
        NXStiffnessReach,
        NXObstacleReach,
        TwoXObstacleReach,
        DualTriangleObstacleReach,
        PlanarFourBarObstacleReach,
    )
}

__all__ = [
    "ARMS",
    "DualTriangleFastReach",
    "DualTriangleObstacleReach",
    "DualTrianglePush",
    "DualTriangleReach",
    "NXObstacleReach",
    "NXReach",
    "NXStiffnessReach",
    "PlanarFourBarObstacleReach",
    "PlanarFourBarReach",
    "SpatialPrismTrack",
    "TwoXFastReach",
    "TwoXObstacleReach",
    "TwoXPostureChange",
    "TwoXReach",
    "TwoXStiffnessReach",
    "core_of",
]


def core_of(arm: str | type[Core], options: dict[str, object]) -> Core:
    """The core of a name in ARMS, or of a class of your own: the class itself, or "module:Class".

    Raises:
        ValueError: there is no such name, module or class.
        TypeError: it is not a subclass of `Core`, or has no such argument.
    """
    if isinstance(arm, str):
        arm = _own(arm) if ":" in arm else _ours(arm)
    if not (isinstance(arm, type) and issubclass(arm, Core)):
        raise TypeError(f"arm = {arm!r}: must be a subclass of Core")
    check_names(arm, options)
    return arm(**options)


def _ours(name: str) -> type[Core]:
    if name not in ARMS:
        raise ValueError(
            f"arm = {name!r}: must be one of {', '.join(map(repr, ARMS))}, or a subclass of Core, itself or as "
            "'module:Class'"
        )
    return ARMS[name]


def _own(name: str) -> Any:
    """A class from "module:Class", which specs of environments can hold as JSON."""
    module, _, class_name = name.partition(":")
    try:
        return getattr(importlib.import_module(module), class_name)
    except (ImportError, ValueError, AttributeError) as error:
        raise ValueError(f"arm = {name!r}: must be 'module:Class', a subclass of Core in it ({error})") from error
