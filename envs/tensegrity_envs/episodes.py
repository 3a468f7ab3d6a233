"""Episodes drawn ahead of their use: many at once cost little more than one."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from tensegrity_envs.compiler.jit import Compiled
from tensegrity_envs.compiler.lowering import Integers, Matrix
from tensegrity_envs.core import Core
from tensegrity_envs.seeding import stored_seed


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
        # Of the places of environment i, i * ahead and on, the k-th one is for its episodes number k, k + ahead, ...
        self._episodes = np.empty((n * ahead, core.episodes.size))
        self._outcomes = np.empty((n * ahead, core.outcomes.size))

    def restart(self, index: int, seed: int | None = None, episode: int = 0) -> None:
        """Let environment `index` go on with the given episode, of a new seed if there is one."""
        if seed is not None:
            self._seeds[index] = stored_seed(seed)
        self._next[index] = episode
        self._left[index] = 0
        self._first = True  # whoever reseeds once may do so again: draw no more than is asked for

    def peek(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Seed and number of the next episode of environment `index`, both of shape (1,)."""
        return self._seeds[index : index + 1].copy(), (self._next - self._left)[index : index + 1]

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
        if not self._left[index].all():
            self._draw(index)
        place = index * self._ahead + (self._next[index] - self._left[index]) % self._ahead
        self._left[index] -= 1
        take = _compiled_take()
        take(self._episodes, place, episodes, index)
        take(self._outcomes, place, outcomes, index)

    def state(self) -> dict[str, np.ndarray]:
        """What determines the coming episodes: the seeds, and the number of the next episode of each."""
        return {"seeds": self._seeds.copy(), "next_episodes": self._next - self._left}

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
        self._episodes[place], self._outcomes[place] = episodes.T, outcomes.T
        self._next += wanted
        self._left += wanted


def _take(rows: Matrix, places: Integers, target: Matrix, columns: Integers) -> None:
    """target[:, columns] = rows[places].T: NumPy takes four times as long."""
    for i in range(target.shape[0]):
        for k in range(len(columns)):
            target[i, columns[k]] = rows[places[k], i]


@cache
def _compiled_take() -> Callable[..., Any]:
    return Compiled(_take)
