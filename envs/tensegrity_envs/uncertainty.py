"""Levels of uncertainty: how far an arm may be from the model that its controllers are told.

Every episode draws its own arm (see `randomization.Randomization`); `info` tells what was drawn, controllers are not
told. Success is measured on the true tip. What the ranges stand for:

- stiffness: catalogues of springs give tolerances of 5 to 10 percent of the rate; 20 percent is a spring of another
  batch, or one that has set.
- mass: bars and platform are weighed to a few percent, but joints, cables, tendons and sensors come on top.
- damping: the least known quantity of a mechanism; between two builds of the same joint it differs by a factor of two.
- friction: of plain bearings; it changes with load, wear and grease as damping does, so it has the same ranges. Only
  where an environment has dry friction.
- bandwidth: of an actuator's current loop and its tendon; it changes with temperature and pretension by a tenth to a
  half. Only where the actuators lag.
- actuation delay: of whole control steps. Camera, bus, computer and motor each take some milliseconds: with a step of
  20 ms up to two steps are usual in one that is not made for speed.
- tip noise: standard deviation of a position from a camera or a motion capture system, 0.5 to 2 mm for arms of up to
  a metre. A mechanism that is larger is seen from farther away, and each pixel is larger in proportion: an environment
  may have these times a `noise_scale`, the planar 4-bar with its bars of 10 m twenty times.
- angle noise: standard deviation of an angle; the step of an encoder of 12 bits is 1.5 mrad.

Each quantity is uniform in its range. An unknown payload or force has the range that the environment has without.

Of several levels, such as `level=[0, 2]` (or "drawn", all there are), every episode draws one, which `info` tells as
random_level and observations do not; the episode is the one of that level alone.
"""

from collections.abc import Collection, Sequence
from types import MappingProxyType
from typing import Any

LEVELS = tuple(
    MappingProxyType(ranges)
    for ranges in (
        {},
        {
            "stiffness": (0.95, 1.05),
            "mass": (0.9, 1.1),
            "damping": (0.75, 1.33),
            "friction": (0.75, 1.33),
            "bandwidth": (0.9, 1.1),
            "actuation_delay": (0, 1),
            "tip_noise": 0.0005,
            "angle_noise": 0.0005,
        },
        {
            "stiffness": (0.9, 1.1),
            "mass": (0.8, 1.2),
            "damping": (0.5, 2.0),
            "friction": (0.5, 2.0),
            "bandwidth": (0.8, 1.25),
            "actuation_delay": (0, 2),
            "tip_noise": 0.001,
            "angle_noise": 0.001,
        },
        {
            "stiffness": (0.8, 1.2),
            "mass": (0.7, 1.3),
            "damping": (0.25, 4.0),
            "friction": (0.25, 4.0),
            "bandwidth": (0.67, 1.5),
            "actuation_delay": (0, 4),
            "tip_noise": 0.002,
            "angle_noise": 0.002,
        },
    )
)


DRAWN = "drawn"  # one of all levels


def checked_level(level: object) -> int:
    """A level of uncertainty; None is 0.

    Raises:
        ValueError: there is no such level.
    """
    if level is None:
        return 0
    if isinstance(level, bool) or not isinstance(level, int) or not 0 <= level < len(LEVELS):
        raise ValueError(f"level = {level!r}: must be a whole number from 0 (none) to {len(LEVELS) - 1}{_OR}")
    return level


_OR = f", or several of them such as [0, 2], or {DRAWN!r} for all, of which each episode draws one"


def checked_levels(level: object) -> tuple[int, ...]:
    """The levels of which each episode draws one; most often it is one alone.

    Raises:
        ValueError: one is none, or there twice, or there are none; the message says what would work.
    """
    if isinstance(level, str) and level == DRAWN:
        return tuple(range(len(LEVELS)))
    if not isinstance(level, Sequence) or isinstance(level, str):
        return (checked_level(level),)
    levels = tuple(checked_level(one) for one in level)
    if not levels or len(set(levels)) != len(levels) or None in level:
        raise ValueError(f"level = {list(level)!r}: must be different levels, at least one, such as [0, 2]")
    return levels


def ranges_of(level: int, applicable: Collection[str], where: str, noise_scale: float = 1.0) -> dict[str, Any]:
    """The ranges of a level, of those quantities that an environment has.

    Args:
        level: from `checked_level`.
        applicable: their names.
        where: the environment, for the message.
        noise_scale: what its tip noise is multiplied by.

    Raises:
        ValueError: it has none of them, and the level is not 0.
    """
    ranges: dict[str, Any] = {name: value for name, value in LEVELS[level].items() if name in applicable}
    if "tip_noise" in ranges:
        ranges["tip_noise"] *= noise_scale
    if level and not ranges:
        raise ValueError(f"level = {level}: nothing is uncertain in {where}")
    return ranges
