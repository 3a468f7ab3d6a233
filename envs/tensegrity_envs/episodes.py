"""Episodes drawn ahead of their use: many at once cost little more than one."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_envs import columns
from tensegrity_envs.compiler.pytree import as_matrix
from tensegrity_envs.core import Core
from tensegrity_envs.seeding import stored_seed

_DRAWN = 12288  # episodes at once, about; half as many cost a tenth more each
_LEAST_AHEAD, _MOST_AHEAD = 4, 64  # episodes of each environment


def checked_options(options: object) -> dict[str, Any]:
    """A copy of the options of `reset`.

    Raises:
        ValueError: they are no dict.
    """
    if options is not None and not isinstance(options, Mapping):
        raise ValueError(f"options = {options!r}: must be a dict, such as {{'episode': 3}}")
    return dict(options or {})


def episodes_ahead(num_envs: int) -> int:
    """How many episodes are drawn ahead for each of so many environments: so many in all that a draw is worth its
    while, which takes a millisecond for a single one, too.
    """
    return min(max(_DRAWN // num_envs, _LEAST_AHEAD), _MOST_AHEAD)


class EpisodeQueue:
    """The coming episodes of n environments. Drawing ahead changes nothing: an episode depends on (seed, number) alone.

    Args:
        core: draws them.
        seeds: shape (n,), one seed for each environment.
        ahead: how many to draw ahead for each environment.
    """

    def __init__(self, core: Core, seeds: np.ndarray, ahead: int) -> None:
        n = len(seeds)
        self._core = core
        self._seeds = seeds
        self._next = np.zeros(n, np.int64)  # number of the first episode not drawn yet
        self._left = np.zeros(n, np.int64)  # how many are drawn and not used yet
        self._first = True
        self._ahead = ahead
        self._sizes = np.array([ahead, 0], np.int64)  # see `columns.take`
        # Of the places of environment i, i * ahead and on, the k-th one is for its episodes number k, k + ahead, ...
        self._episodes = np.empty((n * ahead, core.episodes.size))
        self._outcomes = np.empty((n * ahead, core.outcomes.size))

    @property
    def numbers(self) -> np.ndarray:
        """Of the episodes that were begun last, shape (n,)."""
        return np.asarray(self._next - self._left - 1)

    def restart(self, index: int, seed: int | None = None, episode: int = 0) -> None:
        """Let environment `index` go on with the given episode, of a new seed if there is one."""
        if seed is not None:
            self._seeds[index] = stored_seed(seed)
        self._next[index] = episode
        self._left[index] = 0
        self._first = True  # whoever reseeds once may do so again: draw no more than is asked for

    def peek(self, index: int, seed: int | None = None, episode: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Seed and number, both of shape (1,), of the next episode of environment `index`, or of what `restart` with
        this seed and episode would make it.
        """
        number = (self._next - self._left)[index] if seed is None else 0
        own = self._seeds[index] if seed is None else stored_seed(seed)
        return np.array([own], np.int64), np.array([number if episode is None else episode], np.int64)

    def skip(self, index: int) -> None:
        """Leave out the next episode of environment `index`."""
        if self._left[index]:
            self._left[index] -= 1
        else:
            self._next[index] += 1

    def begin(self, index: np.ndarray, episodes: np.ndarray, outcomes: np.ndarray) -> None:
        """Begin the next episode of each of the environments at `index`.

        Args:
            index: shape (m,).
            episodes: matrix of n columns; those at `index` are overwritten.
            outcomes: the same.
        """
        given = index, self._next, self._left, self._sizes, self._episodes, self._outcomes, episodes, outcomes
        columns.take.run(*given)
        if not self._sizes[1]:
            self._draw(index)
            columns.take.run(*given)

    def state(self) -> dict[str, np.ndarray]:
        """What determines the coming episodes: the seeds, and the number of the next episode of each."""
        return {"seeds": self._seeds.copy(), "next_episodes": self._next - self._left}

    def check(self, state: object, shapes: Mapping[str, tuple[int, ...]], owner: str) -> None:
        """Refuse what is no state that `get_state` told.

        Args:
            state: to be checked.
            shapes: of the arrays that the shell adds.
            owner: which environment this is.

        Raises:
            ValueError: it is not that, or the state of another environment; the message says which.
        """
        known: dict[str, tuple[tuple[int, ...], str]] = {name: (shape, "f8") for name, shape in shapes.items()}
        known |= {name: (self._seeds.shape, "i8") for name in ("seeds", "next_episodes")}
        if not isinstance(state, dict) or state.get("of") != owner:
            whose = state.get("of") if isinstance(state, dict) else None
            raise ValueError(f"state: must be what get_state() of {owner} returned, not of {whose or 'anything else'}")
        for name, (shape, kind) in known.items():
            array = state.get(name)
            if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != kind:
                raise ValueError(f"state: {name!r} must be an array of shape {shape}, as get_state() returned it")

    def go_on(self, state: dict[str, np.ndarray]) -> None:
        """Go on where `state` was told."""
        self._seeds[:], self._next[:] = state["seeds"], state["next_episodes"]
        self._left[:] = 0
        self._first = True

    def _draw(self, index: np.ndarray) -> None:
        wanted = self._ahead - self._left
        if self._first:
            wanted = np.zeros_like(self._left)
            wanted[index] = self._left[index] == 0
            self._first = False
        owner = np.repeat(np.arange(len(wanted)), wanted)
        number = self._next[owner] + np.arange(len(owner)) - np.repeat(np.cumsum(wanted) - wanted, wanted)
        place = owner * self._ahead + number % self._ahead
        episodes, outcomes = self._core.begin(self._seeds[owner], number)
        columns.keep.run(as_matrix(episodes), place, self._episodes)
        columns.keep.run(as_matrix(outcomes), place, self._outcomes)
        self._next += wanted
        self._left += wanted
