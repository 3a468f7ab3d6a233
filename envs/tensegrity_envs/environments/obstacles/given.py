"""The option `obstacles` of an environment: how many discs are drawn, or obstacles of one's own."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from tensegrity_envs.geometry.clearance import Disc, Obstacle, Polygon, Wall, check_one_each

MOST = 8  # discs drawn
_KINDS: dict[str, type[Any]] = {"radius": Disc, "corners": Polygon, "normal": Wall}  # by a field that tells them apart


def checked_obstacles(given: object, may_be_none: bool = False) -> int | tuple[Obstacle, ...]:
    """The number of discs that are drawn for each episode, or the obstacles of all episodes.

    Args:
        given: a number, or a sequence of obstacles; each may be a mapping of its fields, as JSON has it, or with
            arrays in place of lists.
        may_be_none: whether there may be no obstacles, 0 or (): the mechanism's own bars are some already.

    Raises:
        ValueError: it is neither, or an obstacle is not well-formed; the message says which.
    """
    if may_be_none and not isinstance(given, bool) and (given == 0 or given in ((), [])):
        return ()
    if isinstance(given, int | np.integer) and not isinstance(given, bool):
        if not 1 <= given <= MOST:
            besides = "" if given else ", or 0 with own_bars=True"
            raise ValueError(
                f"obstacles = {given!r}: must be from 1 to {MOST} discs, or obstacles of your own{besides}"
            )
        return int(given)
    if not isinstance(given, list | tuple) or not given:
        raise ValueError(
            f"obstacles = {given!r}: must be a number of discs, or a sequence of obstacles such as "
            "{'centre': (0.3, 0.4), 'radius': 0.05}"
        )
    obstacles = tuple(_obstacle(one, f"obstacles[{k}]") for k, one in enumerate(given))
    check_one_each(obstacles)
    return obstacles


def _obstacle(given: object, name: str) -> Obstacle:
    if isinstance(given, Disc | Polygon | Wall):
        return given
    kind = next((_KINDS[key] for key in _KINDS if isinstance(given, Mapping) and key in given), None)
    if kind is None:
        raise ValueError(
            f"{name} = {given!r}: must be a Disc, a convex Polygon or a Wall, or their fields: "
            + "; ".join(", ".join(field.name for field in fields(one)) for one in _KINDS.values())
        )
    assert isinstance(given, Mapping)
    known = [field.name for field in fields(kind)]
    if sorted(given) != sorted(known):
        raise ValueError(f"{name} = {given!r}: a {kind.__name__} has {' and '.join(known)}")
    try:
        numbers = {key: _tupled(value) for key, value in given.items()}
    except (TypeError, ValueError):
        raise ValueError(f"{name} = {given!r}: {' and '.join(known)} must be numbers") from None
    try:
        return kind(**numbers)  # type: ignore[no-any-return]
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error


def _tupled(value: Any) -> Any:
    """Numbers as floats, lists and arrays as tuples."""
    value = value.tolist() if isinstance(value, np.ndarray) else value
    return tuple(_tupled(part) for part in value) if isinstance(value, list | tuple) else float(value)
