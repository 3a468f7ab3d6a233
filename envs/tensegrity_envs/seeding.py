"""Random numbers that are a function of (environment seed, episode, draw) alone.

A counter-based generator, SplitMix64 [Steele, Lea, Flood 2014], evaluated for a whole batch at once: NumPy's own bit
generators would have to be built anew for every environment and episode, which costs more than the episode's physics.
Environment i of a vector seeded s draws exactly what a single environment seeded s + i draws, whatever the batch and
whatever ran before.

Training uses seeds below VALIDATION_SEED; tuning and the published tables use their own streams.
"""

from collections.abc import Callable
from copy import copy

import numpy as np

VALIDATION_SEED = 1_000_000_000
TEST_SEED = 2_000_000_000

_LANES = 8  # tries at once, which cost no more than one does
_WORD = 2**64
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)


def checked_seed(seed: object) -> int:
    """A seed: any non-negative integer, of Python or NumPy.

    Raises:
        ValueError: it is none.
    """
    return _checked_whole_number(seed, "seed")


def checked_episode(episode: object) -> int:
    """The number of an episode, counted from 0.

    Raises:
        ValueError: it is no non-negative integer below 2**62.
    """
    number = _checked_whole_number(episode, "episode")
    if number >= 2**62:
        raise ValueError(f"episode = {episode!r}: must be below 2**62")
    return number


def _checked_whole_number(number: object, name: str) -> int:
    if isinstance(number, bool) or not isinstance(number, int | np.integer) or number < 0:
        raise ValueError(f"{name} = {number!r}: must be a non-negative integer")
    return int(number)


def stored_seed(seed: int) -> int:
    """A seed as arrays of 64-bit integers hold it: itself below 2**63; larger ones are folded into 64 bits."""
    if seed >= _WORD:
        seed = int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0])
    return seed - _WORD if seed >= _WORD // 2 else seed


def _mix(z: np.ndarray) -> np.ndarray:
    z = (z ^ (z >> np.uint64(30))) * _MIX1
    z = (z ^ (z >> np.uint64(27))) * _MIX2
    mixed: np.ndarray = z ^ (z >> np.uint64(31))
    return mixed


def uniform(seed: np.ndarray, episode: np.ndarray, draw: int | np.ndarray) -> np.ndarray:
    """Uniform numbers in [0, 1), one for each (seed, episode) pair, independent for different draws.

    Args:
        seed: shape (n,), integers.
        episode: shape (n,), integers.
        draw: which number of the episode, or an array that broadcasts against seed and episode.
    """
    return _numbers(_keys(seed, episode), draw)


def _keys(seed: np.ndarray, episode: np.ndarray) -> np.ndarray:
    """What all numbers of an episode share, for each (seed, episode) pair."""
    with np.errstate(over="ignore"):
        z = _mix(np.asarray(seed).astype(np.uint64) + _GOLDEN)
        return _mix(z + np.asarray(episode).astype(np.uint64) * _GOLDEN)


def _numbers(keys: np.ndarray, draw: int | np.ndarray) -> np.ndarray:
    """Number `draw` of the episodes with these keys, in [0, 1)."""
    with np.errstate(over="ignore"):
        z = _mix(keys + np.atleast_1d(np.asarray(draw) + 1).astype(np.uint64) * _GOLDEN)
    return (z >> np.uint64(11)) * 2.0**-53


class EpisodeStream:
    """The draws of a batch of episodes, one after another, so that no number is used twice."""

    def __init__(self, seed: np.ndarray, episode: np.ndarray, first: int = 0) -> None:
        self._keys = _keys(seed, episode)
        self._next: int | np.ndarray = first  # a number, or one for each episode

    def uniform(self, low: float = 0.0, high: float = 1.0) -> np.ndarray:
        """The next number of every episode, shape (n,)."""
        self._next += 1
        return low + (high - low) * _numbers(self._keys, self._next - 1)

    def block(self, count: int) -> np.ndarray:
        """The next `count` numbers of every episode, uniform in [0, 1), shape (count, n)."""
        self._next += count
        return _numbers(self._keys[None], self._next - count + np.arange(count)[:, None])

    def skip(self, draws: int) -> None:
        """Leave out the next numbers, which streams made by `at` have used."""
        self._next += draws

    def at(self, index: np.ndarray) -> "EpisodeStream":
        """The same streams for the episodes at `index`, from the next draw on."""
        part = copy(self)
        part._keys = self._keys[index]
        return part

    def tries(self, index: np.ndarray, count: int, draws: int) -> "EpisodeStream":
        """The streams of so many tries for each of the episodes at `index`, all first tries first; of so many draws
        each.
        """
        part = copy(self)
        part._keys = np.tile(self._keys[index], count)
        part._next = self._next + np.repeat(np.arange(count) * draws, len(index))
        return part


def until_found(
    stream: EpisodeStream,
    n: int,
    draws: int,
    attempt: Callable[[np.ndarray, EpisodeStream], tuple[np.ndarray, np.ndarray]],
    complaint: str,
    most: int = 1000,
    error: type[Exception] = RuntimeError,
) -> np.ndarray:
    """For each of n episodes, the first try that is good. Where few are left, more than one is tried at once.

    Args:
        stream: of the episodes; goes on behind the last try.
        n: number of episodes.
        draws: of a try.
        attempt: is told which episodes to try for, shape (m,), and their streams; returns what was found, shape
            (size, m), and whether it is good, shape (m,).
        complaint: message of the error, with a place for how many tries there were.
        most: tries for an episode.
        error: what is raised where no try was good.

    Returns:
        What was found, shape (size, n).

    Raises:
        RuntimeError: no try was good (or `error`).
    """
    pending, tried = np.arange(n), 0
    found: np.ndarray | None = None
    while len(pending) or found is None:
        if tried >= most:
            raise error(complaint.format(most))
        count = min(max(n // (4 * len(pending)), _LANES // len(pending), 1), _LANES, most - tried) if n else 1
        values, good = attempt(np.tile(pending, count), stream.tries(pending, count, draws))
        if found is None:
            found = np.zeros((len(values), n))
        table = good.reshape(count, len(pending))
        done = table.any(axis=0)
        first = (table.argmax(axis=0) * len(pending) + np.arange(len(pending)))[done]
        found[:, pending[done]] = values[:, first]
        pending = pending[~done]
        stream.skip(count * draws)
        tried += count
    return found
