"""Closed curves that a spatial prism can follow within its rates, its stroke and its loads."""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components, to_single
from tensegrity_envs.mechanics.checks import checked_range
from tensegrity_envs.mechanics.polynomials import product
from tensegrity_envs.mechanics.spatial_prism import TRAJECTORIES, SpatialPrism, SpatialPrismDesign
from tensegrity_envs.mechanics.spatial_prism.vectors import norm
from tensegrity_envs.seeding import EpisodeStream, until_found
from tensegrity_envs.simulation.lengths import LengthControl
from tensegrity_envs.simulation.protocol import waves_at

HARMONICS = 2
GRAVITY = 9.81  # [m/s^2]
ONSETS = (0.1, 0.9)  # of the first cycle: when a payload comes
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

    is_traced = False  # see compiler.numbers.Lifting

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

    def sample(self, seed: np.ndarray, episode: np.ndarray, stiffness: np.ndarray | None = None) -> Start:
        """Draw the episodes of the given (seed, episode) pairs, both of shape (n,).

        Args:
            seed: of the environment.
            episode: its number.
            stiffness: factors of the springs' stiffness, shape (n,); None where it is nominal. Poses depend on loads
                divided by stiffnesses alone, all else being geometry.
        """
        n = len(seed)
        stream = EpisodeStream(seed, episode)
        payload = stream.uniform(*self.payload_range)
        onset = np.floor(self.cycle * stream.uniform(*ONSETS))
        seen = payload if stiffness is None else payload / stiffness

        def attempt(owner: np.ndarray, here: EpisodeStream) -> tuple[np.ndarray, np.ndarray]:
            found = self._candidates(here, len(owner))
            return found.reshape(-1, len(owner)), self._can_be_followed(found, seen[owner])

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
        n = len(payload)
        rows = table.transpose(0, 2, 1).reshape(3 * n, -1)
        points = tuple(to_single(product(rows, self._waves)).reshape(3, n, self.cycle))
        following = tuple(np.roll(here, -1, axis=1) for here in points)
        here, there = (tuple(part.ravel() for part in parts) for parts in (points, following))
        limits = _SPEED * self.control.rate, _HEIGHT * float(self.control.lowest(self.prism)), *self._stroke
        passable = np.asarray(evaluate(_is_passable, self.prism.design, here, there, limits))
        good: np.ndarray = np.logical_and.reduce(passable.reshape(n, -1), axis=1)
        index = np.flatnonzero(good & (payload > 0))
        if len(index):
            looks = tuple(place[index, :: max(self.cycle // _LOOKS, 1)] for place in points)
            weight = np.broadcast_to(GRAVITY * payload[index, None], looks[0].shape)
            flat = tuple(place.ravel() for place in looks)
            fine = np.asarray(evaluate(_is_held, self.prism.design, flat, weight.ravel(), self._stroke))
            good[index[~fine.reshape(weight.shape).all(axis=1)]] = False
        return good

    @cached_property
    def _waves(self) -> np.ndarray:
        """Of the mean and the harmonics, in all steps of a cycle, shape (1 + 2 harmonics, cycle)."""
        return np.stack([np.ones(self.cycle), *waves_at(np, np.arange(self.cycle), self.cycle, HARMONICS)])

    @cached_property
    def _stroke(self) -> tuple[float, float]:
        """Lengths of the struts that curves may need [m]."""
        low, high = self.control.bounds(self.prism)
        rim = (1 - _SHARE) / 2 * (high - low)
        return float(low + rim), float(high - rim)


def _is_passable(
    design: SpatialPrismDesign, here: Components, there: Components, limits: tuple[float, float, float, float]
) -> Component:
    """Whether an unloaded prism can be here, and a step later there [m].

    Args:
        design: of the prism.
        here: position of the centroid.
        there: likewise.
        limits: of the way in a step, of the height, and of the struts' lengths, the shortest and the longest one.
    """
    farthest, lowest, shortest, longest = limits
    way = tuple(b - a for a, b in zip(here, there, strict=True))
    lengths = SpatialPrism(design).unloaded_lengths(here)
    return (norm(way) <= farthest) & (here[2] >= lowest) & _is_within(lengths, (shortest, longest))


def _is_within(lengths: Components, bounds: tuple[float, float]) -> Component:
    inside: Component = True
    for length in lengths:
        inside = inside & (length >= bounds[0]) & (length <= bounds[1])
    return inside


def _is_held(
    design: SpatialPrismDesign, position: Components, weight: Component, bounds: tuple[float, float]
) -> Component:
    """Whether lengths within bounds hold a weight [N] at a position [m], with room to spare."""
    prism = SpatialPrism(design)
    force = (0.0, 0.0, -weight)
    q, lengths, left = prism.held(position, force)
    stability, wrench = prism.stability_margin(q, None, force), prism.wrench_margin(q, None, force)
    fine = (stability >= _MIN_MARGIN) & (wrench >= _MIN_MARGIN) & (left <= 1e-6 * prism.rotational_stiffness)
    return fine & _is_within(lengths, bounds)


def _curve(table: np.ndarray) -> Curve:
    return Curve(tuple(table[:, 0]), tuple(tuple(row) for row in table[:, 1:]))
