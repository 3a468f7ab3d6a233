"""Episodes drawn ahead of their use: many at once cost little more than one."""

from collections import deque
from typing import Any

import numpy as np

from tensegrity_envs.core import Core, Episode
from tensegrity_envs.mechanics.two_x import TwoX
from tensegrity_envs.simulation.protocol import State

Begun = tuple[Episode, State]


class EpisodeQueue:
    """The coming episodes of n environments. Drawing ahead changes nothing: an episode depends on (seed, number) alone.

    Args:
        core: draws them.
        seeds: shape (n,), one seed for each environment.
        ahead: how many to draw ahead for each environment.
    """

    def __init__(self, core: Core, seeds: np.ndarray, ahead: int) -> None:
        self._core = core
        self._seeds = seeds
        self._next = np.zeros(len(seeds), np.int64)  # number of the first episode not drawn yet
        self._drawn: list[deque[tuple[Begun, int]]] = [deque() for _ in seeds]
        self._ahead = ahead
        self._first = True

    def restart(self, index: int, seed: int | None = None, episode: int = 0) -> None:
        """Let environment `index` go on with the given episode, of a new seed if there is one."""
        if seed is not None:
            self._seeds[index] = seed
        self._next[index] = episode
        self._drawn[index].clear()
        self._first = True  # whoever reseeds once may do so again: draw no more than is asked for

    def pop(self, index: np.ndarray) -> Begun:
        """The next episode of each of the environments at `index`, as one batch."""
        if any(not self._drawn[i] for i in index):
            self._draw(index)
        items = [self._drawn[i].popleft() for i in index]
        groups: dict[int, tuple[Begun, list[int], list[int]]] = {}
        for position, (begun, row) in enumerate(items):
            _, positions, rows = groups.setdefault(id(begun), (begun, [], []))
            positions.append(position)
            rows.append(row)
        order = np.concatenate([positions for _, positions, _ in groups.values()])
        parts = [(rows_of(begun, np.array(rows))) for begun, _, rows in groups.values()]
        back = np.argsort(order)
        return rows_of(join(parts), back) if len(parts) > 1 else rows_of(parts[0], back)

    def _draw(self, index: np.ndarray) -> None:
        if self._first:
            self._first, owners = False, np.array([i for i in index if not self._drawn[i]])
        else:
            owners = np.repeat(np.arange(len(self._drawn)), [self._ahead - len(queue) for queue in self._drawn])
        numbers = self._next[owners] + _rank(owners)
        begun = self._core.begin(self._seeds[owners], numbers)
        np.add.at(self._next, owners, 1)
        for row, i in enumerate(owners):
            self._drawn[i].append((begun, row))


def _rank(owners: np.ndarray) -> np.ndarray:
    """0, 1, 2, ... within each run of equal owners."""
    starts = np.r_[True, owners[1:] != owners[:-1]]
    position = np.arange(len(owners))
    return position - np.maximum.accumulate(np.where(starts, position, 0))


def rows_of(begun: Begun, rows: Any) -> Begun:
    """Some rows of a batch of begun episodes."""
    episode, state = begun
    goal, solutions = _map(lambda v: v[rows], (episode.goal, episode.solutions))
    return Episode(episode.mechanism.take(rows), goal, solutions), _map(lambda v: v[rows], state)


def join(parts: list[Begun]) -> Begun:
    """One batch after another."""
    count = max(len(episode.solutions or ()) for episode, _ in parts)
    episodes = [repeat_solutions(episode, count) for episode, _ in parts]
    goal, solutions, state = _map(
        lambda *v: np.concatenate(v),
        *[(episode.goal, episode.solutions, state) for episode, (_, state) in zip(episodes, parts, strict=True)],
    )
    return Episode(
        _merge_designs(lambda *v: np.concatenate(v), *[e.mechanism for e in episodes]), goal, solutions
    ), state


def put(old: Begun, new: Begun, index: np.ndarray) -> Begun:
    """The batch `old` with the rows at `index` replaced by `new`."""

    def place(o: np.ndarray, n: np.ndarray) -> np.ndarray:
        merged = o.copy()
        merged[index] = n
        return merged

    count = max(len(old[0].solutions or ()), len(new[0].solutions or ()))
    before, after = (repeat_solutions(episode, count) for episode in (old[0], new[0]))
    goal, solutions, state = _map(place, (before.goal, before.solutions, old[1]), (after.goal, after.solutions, new[1]))
    return Episode(_merge_designs(place, before.mechanism, after.mechanism), goal, solutions), state


def repeat_solutions(episode: Episode, count: int) -> Episode:
    """The episode with its first solution repeated until there are `count`."""
    if episode.solutions is None or len(episode.solutions) == count:
        return episode
    return episode._replace(solutions=episode.solutions + (episode.solutions[0],) * (count - len(episode.solutions)))


def as_floats(begun: Begun) -> Begun:
    """A batch of one on floats."""
    episode, state = rows_of(begun, 0)
    mechanism = episode.mechanism
    if any(isinstance(v, np.generic) for v in vars(mechanism.design).values()):
        values = {name: v.item() if isinstance(v, np.generic) else v for name, v in vars(mechanism.design).items()}
        mechanism = TwoX(type(mechanism.design)(**values))
    goal, solutions, state = _map(lambda v: v.item(), (episode.goal, episode.solutions, state))
    return Episode(mechanism, goal, solutions), state


def _map(function: Any, *values: Any) -> Any:
    """Apply a function to the arrays in equally nested tuples."""
    if isinstance(values[0], tuple):
        parts = [_map(function, *items) for items in zip(*values, strict=True)]
        return type(values[0])(*parts) if hasattr(values[0], "_fields") else tuple(parts)
    return None if values[0] is None else function(*values)


def _merge_designs(function: Any, *mechanisms: TwoX) -> TwoX:
    first = mechanisms[0]
    merged = {
        name: function(*[getattr(m.design, name) for m in mechanisms])
        for name, value in vars(first.design).items()
        if isinstance(value, np.ndarray)
    }
    return TwoX(type(first.design)(**(vars(first.design) | merged))) if merged else first
