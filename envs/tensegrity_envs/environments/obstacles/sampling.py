"""Episodes among obstacles that can be solved: for each a joint path that keeps clear of them is known."""

from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from tensegrity_envs.compiler.kernel import Kernel
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.compiler.pytree import Schema, tree_map
from tensegrity_envs.environments.obstacles.spaces import JointSpace
from tensegrity_envs.geometry.clearance import Disc, Obstacle, bars_of, clearance
from tensegrity_envs.seeding import EpisodeStream, until_found

SAFE = 0.025  # of the reach: clearance of start, target and hidden path
_RADII = 0.03, 0.08  # of the reach
_SHARES = 0.15, 0.85  # of the straight path, where the first disc cuts it
_DEPTH = 0.8  # of its radius is the arm at most away from its centre there
_OUTWARD = 0.25  # power of a uniform number that chooses the bar: mostly one of the last
_FROM_BASE = 0.2  # of the reach: no disc has its centre nearer than that to the base
_CANDIDATES = 16  # of the path, for every start and target
_ENDS, _COARSE, _HELD, _FINE = 2, 12, 64, 256  # looks along each leg of a path, the cheapest first
_NUMBERS = 6  # by which a disc is drawn across a path
_FIRST_DRAW = 1 << 23  # beyond all other draws of an episode
_APART = 1 << 22  # draws of a disc at most
_KEYS = 2.0**53
_MOST = 4000  # tries
_NO_DRAW = "obstacles: no start and target found clear of them in {} draws: give fewer or smaller ones", RuntimeError
_NO_ROOM = (
    "obstacles: those given leave no start and target that can be reached (none found in {} draws): give smaller ones, "
    "or ones that are farther from the base",
    ValueError,
)


class Solvable(Protocol):
    """An environment without obstacles, as far as its episodes are drawn."""

    nominal: Any
    sampler: Any

    def mechanism(self, design: Any) -> Any:
        """The mechanism of a design."""
        ...

    def solved(self, seed: np.ndarray, episode: np.ndarray) -> tuple[Any, Components]:
        """Episodes, and a configuration (or inputs) that solves each of them."""
        ...


class Path(NamedTuple):
    """Paths of n episodes, arrays of shape (coordinates, n), of joint angles [rad] or what `spaces` has.

    Attributes:
        start: where they begin.
        via: to which they go straight.
        end: where they go straight from there.
    """

    start: np.ndarray
    via: np.ndarray
    end: np.ndarray

    def take(self, index: np.ndarray) -> "Path":
        """The paths of some episodes."""
        return Path(*(part[:, index] for part in self))

    def looks(self, count: int) -> np.ndarray:
        """Places along the paths, (coordinates, 2 * count * n): those of all paths at one look after another."""
        share = np.linspace(0.0, 1.0, count)[:, None, None]
        legs = [a + share * (b - a) for a, b in ((self.start, self.via), (self.via, self.end))]
        return np.concatenate(legs).transpose(1, 0, 2).reshape(len(self.start), -1)


class ObstacleSampler:
    """Draws starts, targets and discs, each a function of (seed, episode) alone.

    Every try draws a start and a target as the environment without obstacles does, and a configuration on the way. The
    first disc is put where the arm would be on the straight joint path from start to target, and counts if the way
    round keeps clear of it; so the straight path is cut, and a free one is known. The other discs are anywhere clear of
    that path. Obstacles of one's own are kept: then start, target and the way are drawn until they are clear of them.
    The way need not be the best one, and is told to nobody.

    "Clear" is by 2.5 % of the reach at 256 looks along each leg, between which no point of the arm moves further than
    about twice that; and within the set in which the mechanism can be held, at 64 looks.

    Args:
        core: of the environment without obstacles. What is randomized there does not change its geometry.
        obstacles: how many discs to draw, or those that there are.
        space: in which paths are straight.
        own: pairs of the mechanism's own bars that must not touch each other.
    """

    is_traced = False  # see compiler.numbers.Lifting

    def __init__(
        self,
        core: Solvable,
        obstacles: int | tuple[Obstacle, ...],
        space: JointSpace,
        own: tuple[tuple[str, str], ...] = (),
    ) -> None:
        self.core, self.space, self.own = core, space, own
        self.given = () if isinstance(obstacles, int) else obstacles
        self.count = obstacles if isinstance(obstacles, int) else 0
        self.coordinates = space.size + space.kept
        self.reach = float(core.nominal.reach)
        self.safe = SAFE * self.reach

    @cached_property
    def _bars(self) -> Kernel:
        """The ends of the bars at some coordinates."""
        nominal, space = self.core.nominal, self.space
        return Kernel(lambda place: tuple(bars_of(nominal, *space.posture(place)).values()), self._places)

    @cached_property
    def _gap(self) -> Kernel:
        """Clearance from one disc or, where none are drawn, from the obstacles that there are."""
        nominal, given, own, space = self.core.nominal, self.given, self.own, self.space
        disc = Schema((np.zeros(1),) * (3 if self.count else 0))

        def gap(place: Components, numbers: Components) -> Component:
            q, inputs = space.posture(place)
            return clearance(nominal, q, given or discs_of(numbers), inputs, own)

        return Kernel(gap, self._places, disc)

    @property
    def _places(self) -> Schema[Components]:
        return Schema((np.zeros(1),) * self.coordinates)

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> tuple[Any, tuple[Obstacle, ...]]:
        """Draw the episodes of the given (seed, episode) pairs, both of shape (n,).

        Returns:
            The episodes as `Solvable.solved` returns them, and their obstacles.

        Raises:
            ValueError: none keeps clear of the obstacles that were given.
            RuntimeError: there were none that keep clear of the discs that are drawn.
        """
        n, size = len(seed), self.coordinates
        streams = [EpisodeStream(seed, episode, _FIRST_DRAW + k * _APART) for k in range(max(self.count, 1))]

        def attempt(owner: np.ndarray, here: EpisodeStream) -> tuple[np.ndarray, np.ndarray]:
            return self._try(episode[owner], here)

        complaint, kind = _NO_DRAW if self.count else _NO_ROOM
        count = 1 + _CANDIDATES * (self.space.size + _NUMBERS)
        found = until_found(streams[0], n, count, attempt, complaint, _MOST, kind)
        path = Path(*found[1 : 1 + 3 * size].reshape(3, size, n))
        discs = found[1 + 3 * size :]

        def more(owner: np.ndarray, here: EpisodeStream) -> tuple[np.ndarray, np.ndarray]:
            disc = self._anywhere(here)
            return disc, self._is_clear(path.take(owner), disc)

        for stream in streams[1:]:
            disc = until_found(stream, n, 3, more, "obstacles: no disc found clear of the path in {} draws", _MOST)
            discs = np.concatenate([discs, disc])
        return self.core.solved(_as_seeds(found[0]), episode)[0], (*discs_of(tuple(discs)), *_columns(self.given, n))

    def _try(self, episode: np.ndarray, stream: EpisodeStream) -> tuple[np.ndarray, np.ndarray]:
        """For m episodes a start and a target, and the first good one of several ways and discs, if there is any."""
        m, size, space = len(episode), self.space.size, self.space
        key = np.floor(_KEYS * stream.uniform())
        sampled, target = self.core.solved(_as_seeds(key), episode)
        block = stream.block(_CANDIDATES * (size + _NUMBERS)).reshape(_CANDIDATES, -1, m)
        numbers = block.transpose(1, 0, 2).reshape(size + _NUMBERS, -1)
        start, end = (np.tile(np.stack(place), _CANDIDATES) for place in space.ends(sampled, target))
        path = Path(start, np.concatenate([space.limit * (2 * numbers[:size] - 1), start[size:]]), end)
        disc = self._across(path, numbers[size:]) if self.count else numbers[:0]
        mechanism = self.core.mechanism(sampled.episode.design)
        good = self._is_clear(path, disc, (mechanism, m)).reshape(_CANDIDATES, m)
        first = good.argmax(axis=0) * m + np.arange(m)
        return np.concatenate([key[None], *path.take(first), disc[:, first]]), np.asarray(good.any(axis=0))

    def _across(self, path: Path, numbers: np.ndarray) -> np.ndarray:
        """Discs across the straight paths, (3, m), from numbers uniform in [0, 1)."""
        share = _SHARES[0] + (_SHARES[1] - _SHARES[0]) * numbers[0]
        m, bars = len(share), self._bars(path.start + share * (path.end - path.start))
        bar = np.floor(numbers[1] ** _OUTWARD * (len(bars) // 4)).astype(int)
        x, y, to_x, to_y = (bars[4 * bar + k, np.arange(m)] for k in range(4))
        radius = self.reach * (_RADII[0] + (_RADII[1] - _RADII[0]) * numbers[2])
        off, angle = _DEPTH * radius * np.sqrt(numbers[3]), 2 * np.pi * numbers[4]
        x, y = x + numbers[5] * (to_x - x), y + numbers[5] * (to_y - y)
        return np.stack([x + off * np.cos(angle), y + off * np.sin(angle), radius])

    def _anywhere(self, stream: EpisodeStream) -> np.ndarray:
        """Discs within reach, (3, m)."""
        far, angle = self.reach * np.sqrt(stream.uniform()), stream.uniform(-np.pi, np.pi)
        radius = _RADII[0] + (_RADII[1] - _RADII[0]) * stream.uniform()
        return np.stack([far * np.cos(angle), far * np.sin(angle), self.reach * radius])

    def _is_clear(self, path: Path, disc: np.ndarray, held: tuple[Any, int] | None = None) -> np.ndarray:
        """Whether paths keep clear of discs (3, m), or of what obstacles there are, and can be held.

        Args:
            path: m paths.
            disc: x, y, radius [m].
            held: a batch of mechanisms and how many they are; path i is of mechanism i modulo that number. None where
                all paths are known to be held.
        """
        good = np.ones(path.start.shape[1], bool)
        if self.count:
            good = (np.hypot(*disc[:2]) >= _FROM_BASE * self.reach) & (np.abs(disc[:2]).max(axis=0) <= self.reach)

        def is_apart(q: np.ndarray, index: np.ndarray) -> np.ndarray:
            return np.asarray(self._gap(q, np.ascontiguousarray(disc[:, index]))[0] >= self.safe)

        def is_held(q: np.ndarray, index: np.ndarray) -> np.ndarray:
            assert held is not None
            mechanism, count = held
            return self.space.inside(mechanism, index % count, tuple(q))

        tests = [(_ENDS, is_apart), (_COARSE, is_apart), (_HELD, is_held), (_FINE, is_apart)]
        for looks, test in tests:
            if test is is_held and held is None:
                continue
            left = np.flatnonzero(good)
            index = np.tile(left, 2 * looks)
            if len(left):
                good[left] = test(path.take(left).looks(looks), index).reshape(-1, len(left)).all(axis=0)
        return good


def discs_of(numbers: Components) -> tuple[Disc, ...]:
    """Discs of x, y and radius of each; not validated: parts of batches that are drawn are valid."""
    discs = []
    for k in range(0, len(numbers), 3):
        disc = object.__new__(Disc)
        vars(disc).update(centre=tuple(numbers[k : k + 2]), radius=numbers[k + 2])
        discs.append(disc)
    return tuple(discs)


def _columns(obstacles: tuple[Obstacle, ...], n: int) -> tuple[Obstacle, ...]:
    """The same obstacles in each of n episodes."""
    return tuple(
        tree_map(lambda value: np.full(n, value), one, lambda part: isinstance(part, float)) for one in obstacles
    )


def _as_seeds(numbers: np.ndarray) -> np.ndarray:
    return numbers.astype(np.int64)
