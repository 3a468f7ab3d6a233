"""Arguments of a vector environment, checked before anything is made or changed."""

from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

_LONGEST = 2**31  # steps
_INFOS = ("full", "goal", "none")


def checked_count(num_envs: object) -> int:
    """A number of environments.

    Raises:
        ValueError: it is no positive whole number.
    """
    if isinstance(num_envs, bool) or not isinstance(num_envs, int | np.integer) or num_envs < 1:
        raise ValueError(f"num_envs = {num_envs!r}: must be a whole number, at least 1")
    return int(num_envs)


def checked_info(info: object) -> str:
    """How much info there is to be.

    Raises:
        ValueError: it is none of the names.
    """
    if info not in _INFOS:
        raise ValueError(f"info = {info!r}: must be one of {', '.join(map(repr, _INFOS))}")
    return str(info)


def checked_limit(max_episode_steps: int | None) -> int | None:
    """A time limit; None for none, which Gymnasium writes as -1, too.

    Raises:
        ValueError: it is no positive whole number.
    """
    if max_episode_steps is None or max_episode_steps == -1:
        return None
    is_whole = isinstance(max_episode_steps, int | np.integer) and not isinstance(max_episode_steps, bool)
    if not is_whole or not 1 <= max_episode_steps <= _LONGEST:
        raise ValueError(
            f"max_episode_steps = {max_episode_steps!r}: must be a whole number from 1 to {_LONGEST}, or -1 for none"
        )
    return int(max_episode_steps)


def checked_mode(mode: str | AutoresetMode) -> AutoresetMode:
    """An autoreset mode, given as Gymnasium's or by its name.

    Raises:
        ValueError: there is no such mode.
    """
    for known in AutoresetMode:
        if mode in (known, known.value, known.name):
            return known
    names = ", ".join(repr(known.value) for known in AutoresetMode)
    raise ValueError(f"autoreset_mode = {mode!r}: must be one of {names}, or a gymnasium.vector.AutoresetMode")


def for_each(count: int, given: object, what: str, check: Callable[[Any], int], later: int) -> list[int | None]:
    """The checked numbers of all environments, from one number, a list of numbers or None.

    Args:
        count: of the environments.
        given: the first environment's number; or a list of one number, or None, for each.
        what: the numbers are, for the message.
        check: of a number.
        later: how much larger the number of each next environment is, if there is one number.

    Raises:
        ValueError: there are not as many numbers as environments.
    """
    if given is None:
        return [None] * count
    if not isinstance(given, list | tuple | np.ndarray) or np.ndim(given) == 0:
        return [check(given) + i * later for i in range(count)]
    if len(given) != count:
        raise ValueError(f"{len(given)} {what} for {count} environments")
    return [None if number is None else check(number) for number in given]
