"""Episodes drawn ahead of their use: many at once cost little more than one."""

import numpy as np

from tensegrity_envs.core import Core


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
        # Place k of an environment's store is for its episodes number k, k + ahead, ...
        self._episodes = np.empty((n, ahead, core.episodes.size))
        self._outcomes = np.empty((n, ahead, core.outcomes.size))

    def restart(self, index: int, seed: int | None = None, episode: int = 0) -> None:
        """Let environment `index` go on with the given episode, of a new seed if there is one."""
        if seed is not None:
            self._seeds[index] = seed
        self._next[index] = episode
        self._left[index] = 0
        self._first = True  # whoever reseeds once may do so again: draw no more than is asked for

    def pop(self, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The next episode of each of the environments at `index`: matrices of episodes and outcomes."""
        if not self._left[index].all():
            self._draw(index)
        place = (self._next[index] - self._left[index]) % self._episodes.shape[1]
        self._left[index] -= 1
        episodes, outcomes = self._episodes[index, place], self._outcomes[index, place]
        return np.ascontiguousarray(episodes.T), np.ascontiguousarray(outcomes.T)

    def _draw(self, index: np.ndarray) -> None:
        ahead = self._episodes.shape[1]
        wanted = ahead - self._left
        if self._first:
            wanted = np.zeros_like(self._left)
            wanted[index] = self._left[index] == 0
            self._first = False
        owner = np.repeat(np.arange(len(wanted)), wanted)
        number = self._next[owner] + np.arange(len(owner)) - np.repeat(np.cumsum(wanted) - wanted, wanted)
        place = number % ahead
        episodes, outcomes = self._core.begin(self._seeds[owner], number)
        self._episodes[owner, place], self._outcomes[owner, place] = episodes.T, outcomes.T
        self._next += wanted
        self._left += wanted
