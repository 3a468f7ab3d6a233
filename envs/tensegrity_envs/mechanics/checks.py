"""Checks of numbers that users hand in."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import Component, detached


def check_finite(name: str, values: Sequence[Component], count: int) -> None:
    """Raise ValueError unless these are `count` finite numbers (or arrays of them)."""
    check_count(name, values, count)
    for value in values:
        if not np.all(np.isfinite(np.asarray(detached(value), float))):
            raise ValueError(f"{name} = {values!r}: must be finite numbers")


def check_count(name: str, values: Sequence[Component], count: int) -> None:
    """Raise ValueError unless there are `count` components. Traceable: their values are not looked at."""
    if len(values) != count:
        raise ValueError(f"{name}: {count} numbers expected, got {len(values)}: {values!r}")


def check_single(probe: Any, what: str) -> None:
    """Raise ValueError for a batch of designs."""
    if isinstance(probe, np.ndarray):
        raise ValueError(f"{what} takes one design, not a batch of them; take(index) picks one")


def checked_range(name: str, given: Any, unit: str, default: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
    """(low, high) with 0 <= low <= high, from two numbers or None for the default.

    Raises:
        ValueError: it is not that.
    """
    if given is None:
        return default
    try:
        low, high = (float(end) for end in given)
        fine = not isinstance(given, str) and 0 <= low <= high and bool(np.isfinite(high))
    except (TypeError, ValueError):
        fine = False
    if not fine:
        raise ValueError(f"{name} = {given!r}: must be (low, high) with 0 <= low <= high, in {unit}")
    return low, high
