"""The mechanisms as environments: how each is drawn, driven and seen."""

import inspect
from difflib import get_close_matches

from tensegrity_envs.core import Core
from tensegrity_envs.environments.dual_triangle import DualTrianglePush, DualTriangleReach
from tensegrity_envs.environments.planar_four_bar import PlanarFourBarReach
from tensegrity_envs.environments.spatial_prism import SpatialPrismTrack
from tensegrity_envs.environments.two_x import TwoXPostureChange, TwoXReach

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
    known = [name for name in inspect.signature(arm).parameters if name != "self"]
    for name in options:
        if name not in known:
            close = get_close_matches(name, known, 1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            # Python's own words for it: clients such as TorchRL try arguments, and look for these in the message.
            raise TypeError(
                f"{arm.__name__} got an unexpected keyword argument {name!r}{hint}; there are {', '.join(known)}"
            )
    return arm(**options)
