"""Whether a controller fits an environment: it was made for one, and misreads another, or is wrong about it."""

from typing import Any

from tensegrity_envs.core import Core
from tensegrity_envs.randomization import DrawnLevel
from tensegrity_envs.uncertainty import LEVELS
from tensegrity_envs.uncertainty import ranges_of as level_ranges


def check_made_for(mine: Core, theirs: Core, is_told_ranges: bool) -> None:
    """Refuse a controller where it was not made for.

    Args:
        mine: the environment that it was made for.
        theirs: the one that it is to act in.
        is_told_ranges: whether it was told the ranges of what differs from episode to episode.

    Raises:
        ValueError: observations, actions, design, or dynamics are others, or ranges that it was told; the message
            names both.
    """
    if mine is theirs:
        return
    pairs: list[tuple[str, object, object]] = [
        ("observations", _observed(mine), _observed(theirs)),
        ("an action", _acted(mine), _acted(theirs)),
        ("the design", mine.design, theirs.design),
    ]
    if mine.dynamics is not None and theirs.dynamics is not None:
        pairs.append(("the dynamics", mine.dynamics, theirs.dynamics))
    if is_told_ranges:
        pairs.append(("uncertainty", ranges_of(mine), ranges_of(theirs)))
    for what, own, other in pairs:
        if own != other:
            raise ValueError(f"made for another environment: {what} there: {own}; here: {other}")


def ranges_of(core: Core) -> str:
    """What differs from episode to episode and controllers are told, as a level of uncertainty or range by range."""
    drawn, payload = core.randomization, getattr(core, "payload_range", None)
    given = {name: getattr(drawn, name) for name in drawn.names}
    applicable = core.randomizable if core.observe_all else core.randomizable - {"angle_noise"}
    levels = [level_ranges(k, applicable, "", core.noise_scale) if applicable else {} for k in range(len(LEVELS))]
    if isinstance(drawn, DrawnLevel):
        text = f"levels {list(drawn.levels)}, {given}"
    else:
        text = f"level {levels.index(given)}" if given in levels else f"randomization {given}"
    return text if payload is None else f"{text}, payload of {float(payload[0]):g} to {float(payload[1]):g} kg"


def _observed(core: Core) -> str:
    return ", ".join(f"{field.name} [{field.unit}] as {field.scaling}" for field in core.schema.fields.values())


def _acted(core: Core) -> str:
    simulation: Any = core.simulation
    return f"{simulation.action_size} numbers, 1 for {float(simulation.rate):.5g} {simulation.rate_unit} in a step"
