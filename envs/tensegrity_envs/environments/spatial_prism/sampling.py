"""Closed curves that a spatial prism can follow within its rates, its stroke and its loads."""

from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.checks import checked_range
from tensegrity_envs.mechanics.spatial_prism import TRAJECTORIES, SpatialPrism, SpatialPrismDesign
from tensegrity_envs.seeding import EpisodeStream, until_found
from tensegrity_envs.simulation.lengths import LengthControl
from tensegrity_envs.simulation.protocol import Episode

HARMONICS = 2
GRAVITY = 9.81  # [m/s^2]
_SHARE = 0.97  # of the stroke
_SPEED = 0.8  # of the rate: at most, of the curve; without a load no strut is faster than the platform
_HEIGHT = 2.0  # times the lowest one
_MIN_MARGIN = 0.05  # of stability and wrench feasibility
_AT_ONCE = 64  # curves that are looked at
_LOOKS = 25  # at the loaded prism, along the curve
_MAX_ATTEMPTS = 300
_PUBLISHED_SHARE = 0.25  # of the episodes, for each published trajectory
_DRAWS = 4 + 3 + 3 * 2 * HARMONICS


class Curve(NamedTuple):
    """A closed curve: its mean [m], and the amplitudes of its harmonics for every axis, see `Episode.motion`."""

    mean: Components
    motion: tuple[Components, ...]

    def at(self, cycle: int, time: Component) -> Components:
        """Position after so many steps [m]."""
        return Episode(None, (), (), self.mean, motion=self.motion, cycle=cycle).goal_at(time)


class Start(NamedTuple):
    """What is drawn for n episodes: curves, payloads [kg], and the steps from which on they act."""

    curve: Curve
    payload: np.ndarray
    onset: np.ndarray


class Sampler:
    """Draws curves and payloads, each a function of (seed, episode) alone.

    Args:
        prism: nominal.
        control: its simulation.
        trajectory: a name of `TRAJECTORIES` (from its beginning), "random", or "mixed": a quarter of the episodes each
            of [Jahromy]'s two, begun anywhere, and half of them random.
        cycle: steps of a cycle.
        payload_range: [kg].
    """

    def __init__(
        self,
        prism: SpatialPrism,
        control: LengthControl,
        trajectory: str,
        cycle: int,
        payload_range: tuple[float, float] | None,
    ) -> None:
        known = ("mixed", "random", *TRAJECTORIES)
        if trajectory not in known:
            raise ValueError(f"trajectory = {trajectory!r}: must be one of {', '.join(map(repr, known))}")
        if isinstance(cycle, bool) or not isinstance(cycle, int) or cycle < 2:
            raise ValueError(f"cycle = {cycle!r}: must be an integer, at least 2 steps")
        low, high = checked_range("payload_range", payload_range, "kg")
        self.prism, self.control, self.trajectory = prism, control, trajectory
        self.cycle, self.payload_range = cycle, (low, high)
        self.size = float(prism.design.D) / 0.5  # the published trajectories and these ranges are for D = 0.5 m
        self.published = {name: self._harmonics(curve) for name, curve in TRAJECTORIES.items()}

    def _harmonics(self, curve: Any) -> np.ndarray:
        """Mean and amplitudes of a published trajectory, shape (3, 1 + 2 harmonics) [m]."""
        t = np.arange(64) / 64
        points = self.size * np.stack(curve(t))
        waves = [np.ones(64)]
        for k in range(1, HARMONICS + 1):
            waves += [2 * np.cos(2 * np.pi * k * t), 2 * np.sin(2 * np.pi * k * t)]
        return points @ np.stack(waves, axis=1) / 64

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> Start:
        """Draw the episodes of the given (seed, episode) pairs, both of shape (n,)."""
        n = len(seed)
        stream = EpisodeStream(seed, episode)
        payload = stream.uniform(*self.payload_range)
        onset = np.floor(self.cycle * stream.uniform(0.1, 0.9))

        def attempt(owner: np.ndarray, here: EpisodeStream) -> tuple[np.ndarray, np.ndarray]:
            found = self._candidates(here, len(owner))
            return found.reshape(-1, len(owner)), self._can_be_followed(found, payload[owner])

        complaint = (
            f"no curve found that {self.prism.design} can follow in {{}} draws: lower payload_range, or raise cycle"
        )
        found = until_found(stream, n, _DRAWS, attempt, complaint, _MAX_ATTEMPTS)
        return Start(_curve(found.reshape(3, 1 + 2 * HARMONICS, n)), payload, onset)

    def _candidates(self, stream: EpisodeStream, n: int) -> np.ndarray:
        """Mean and amplitudes, shape (3, 1 + 2 harmonics, n) [m]."""
        kind, phase = stream.uniform(), stream.uniform()
        radius, angle = 0.15 * np.sqrt(stream.uniform()), stream.uniform(-np.pi, np.pi)
        height = stream.uniform(0.3, 0.7)
        spread = stream.uniform(0.3, 1.0), stream.uniform(0.0, 1.0)
        widths = np.array([0.2, 0.2, 0.12])
        random = np.empty((3, 1 + 2 * HARMONICS, n))
        random[:, 0] = radius * np.cos(angle), radius * np.sin(angle), height
        for axis, width in enumerate(widths):
            for j in range(2 * HARMONICS):
                first = j < 2
                random[axis, 1 + j] = stream.uniform(-1, 1) * (width * spread[0] if first else 0.25 * width * spread[1])
        random *= self.size
        if self.trajectory == "random":
            return random
        if self.trajectory != "mixed":
            return np.repeat(self.published[self.trajectory][..., None], n, axis=2)
        for i, name in enumerate(TRAJECTORIES):
            moved = self.published[name][..., None].repeat(n, axis=2)
            for k in range(1, HARMONICS + 1):
                c, s = np.cos(2 * np.pi * k * phase), np.sin(2 * np.pi * k * phase)
                a, b = moved[:, 2 * k - 1].copy(), moved[:, 2 * k].copy()
                moved[:, 2 * k - 1], moved[:, 2 * k] = a * c + b * s, b * c - a * s
            chosen = (kind >= i * _PUBLISHED_SHARE) & (kind < (i + 1) * _PUBLISHED_SHARE)
            random = np.where(chosen, moved, random)
        return random

    def _can_be_followed(self, table: np.ndarray, payload: np.ndarray) -> np.ndarray:
        """Which curves are slow and high enough, and within stroke and wrench feasibility, with the payload too."""
        parts = [slice(first, first + _AT_ONCE) for first in range(0, len(payload), _AT_ONCE)]
        good = np.zeros(len(payload), bool)
        for part in parts:
            good[part] = self._can_some_be_followed(table[..., part], payload[part])
        return good

    def _can_some_be_followed(self, table: np.ndarray, payload: np.ndarray) -> np.ndarray:
        """The same of so few that the points of their curves stay in the processor's cache."""
        curve = _curve(table[..., None, :])
        points = curve.at(self.cycle, np.arange(self.cycle)[:, None])  # components of shape (steps, n)
        squares = sum((np.concatenate([here[1:], here[:1]]) - here) ** 2 for here in points)
        good: np.ndarray = (np.sqrt(squares) <= _SPEED * self.control.rate).all(axis=0)
        good &= (points[2] >= _HEIGHT * self.control.lowest(self.prism)).all(axis=0)
        index = np.flatnonzero(good)
        good[index] = self._within_stroke(self.prism.unloaded_lengths(tuple(here[:, index] for here in points)))
        index = np.flatnonzero(good & (payload > 0))
        if len(index):
            looks = tuple(here[:: max(self.cycle // _LOOKS, 1), index] for here in points)
            weight = np.broadcast_to(GRAVITY * payload[index], looks[0].shape)
            flat = tuple(here.ravel() for here in looks)
            lengths, stability, wrench, left = evaluate(_held, self.prism.design, flat, weight.ravel())
            fine = (stability >= _MIN_MARGIN) & (wrench >= _MIN_MARGIN)
            fine &= left <= 1e-6 * self.prism.rotational_stiffness
            fine = fine.reshape(weight.shape).all(axis=0)
            fine &= self._within_stroke(tuple(l.reshape(weight.shape) for l in lengths))
            good[index[~fine]] = False
        return np.asarray(good)

    def _within_stroke(self, lengths: Components) -> np.ndarray:
        low, high = self.control.bounds(self.prism)
        rim = (1 - _SHARE) / 2 * (high - low)
        inside = [(length >= low + rim) & (length <= high - rim) for length in lengths]
        return np.asarray(np.logical_and.reduce(inside).all(axis=0))


def _held(
    design: SpatialPrismDesign, position: Components, weight: Component
) -> tuple[Components, Component, Component, Component]:
    """Lengths that hold a weight at a position [m], stability and wrench margin there, and the moment left [N m]."""
    prism = SpatialPrism(design)
    force = (0.0, 0.0, -weight)
    q, lengths, left = prism.held(position, force)
    return lengths, prism.stability_margin(q, None, force), prism.wrench_margin(q, None, force), left


def _curve(table: np.ndarray) -> Curve:
    return Curve(tuple(table[:, 0]), tuple(tuple(row) for row in table[:, 1:]))
