"""Episodes of the planar 4-bar mechanism that can be solved."""

from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.mechanics.checks import checked_range
from tensegrity_envs.mechanics.equilibrium import continuation
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar, PlanarFourBarDesign
from tensegrity_envs.seeding import EpisodeStream, until_found
from tensegrity_envs.simulation.actuator_lengths import LoadedLengthControl

_MARGIN = 0.1  # stability margin of unloaded starts and targets [-]
_LOADED_MARGIN = 0.02  # under a load
_LEGS = 3  # of the walk from the start to the target
_WALK = 80  # steps that the walk takes at most


class Start(NamedTuple):
    """Configurations [rad], lengths [m] and loads [N] of n mechanisms at rest, tips that they can reach [m], the sides
    of CD on which they begin, 1 or -1, and the lengths [m] that put the tips there.
    """

    configuration: Components
    lengths: Components
    load: Components
    target: Components
    side: np.ndarray
    target_lengths: Components


class Sampler:
    """Draws loads, starts and targets, each a function of (seed, episode) alone.

    Starts are rectangles on a random side, their actuator lengths uniform over the quarter disc in which there are any.
    Without a load a target is another one on the same side: the set of lengths is connected, so that it can be reached.
    With one, the load is put on gradually, and the target is where a random walk of the lengths ends that the loaded
    mechanism follows without snapping or exceeding its thrusts: three straight legs, at most 80 steps at full rate; a
    leg on which that fails is not taken.

    Args:
        mechanism: nominal.
        control: its simulation.
        load_range: of the size of the force on F, in units of K L; None for no load.
    """

    is_traced = False  # see compiler.numbers.Lifting

    def __init__(
        self, mechanism: PlanarFourBar, control: LoadedLengthControl, load_range: tuple[float, float] | None
    ) -> None:
        self.mechanism, self.control = mechanism, control
        low, high = checked_range("load_range", load_range, "units of K L")
        self.load_range = (low, high)
        # What inverse solutions of targets have, which are told in single precision.
        self.safe_margin = 0.9 * (_LOADED_MARGIN if any(self.load_range) else _MARGIN)

    def sample(self, seed: np.ndarray, episode: np.ndarray, stiffness: np.ndarray | None = None) -> Start:
        """Draw the episodes of the given (seed, episode) pairs, both of shape (n,).

        Args:
            seed: of the environment.
            episode: its number.
            stiffness: factors of the springs' stiffness, shape (n,); None where it is nominal. Configurations and
                margins depend on the load divided by K alone, all else being geometry.
        """
        n = len(seed)
        stream = EpisodeStream(seed, episode)
        size = float(self.mechanism.largest_force) * stream.uniform(*self.load_range)
        direction = stream.uniform(-np.pi, np.pi)
        load = np.stack([size * np.cos(direction), size * np.sin(direction)])
        seen = load if stiffness is None else load / stiffness
        side = np.where(stream.uniform() < 0.5, -1.0, 1.0)
        draws = 2 + 2 * _LEGS if any(self.load_range) else 4

        def attempt(owner: np.ndarray, here: EpisodeStream) -> tuple[np.ndarray, np.ndarray]:
            q, lengths, target, end, good = self._try(here, side[owner], tuple(seen[:, owner]))
            return np.stack([*q, *lengths, *target, *end]), good

        complaint = f"no start found for {self.mechanism.design} in {{}} draws: lower load_range"
        found = until_found(stream, n, draws, attempt, complaint)
        return Start(tuple(found[:2]), tuple(found[2:4]), tuple(load), tuple(found[4:6]), side, tuple(found[6:]))

    def _lengths(self, stream: EpisodeStream) -> Components:
        """Uniform over the quarter disc of radius 2 L, within the stroke."""
        radius, angle = np.sqrt(stream.uniform()), stream.uniform(0.0, np.pi / 2)
        low, high = self.control.bounds(self.mechanism)
        far = 2 * self.mechanism.length * radius
        return np.clip(far * np.cos(angle), low, high), np.clip(far * np.sin(angle), low, high)

    def _try(self, stream: EpisodeStream, side: np.ndarray, load: Components) -> Any:
        """Configurations, lengths, targets, lengths there, and which of them are good."""
        lengths = self._lengths(stream)
        square, rest = self.mechanism.flatness(lengths)
        good = 2 * np.minimum(square, rest) >= _MARGIN
        if not any(self.load_range):
            goal = self._lengths(stream)
            square, rest = self.mechanism.flatness(goal)
            good &= 2 * np.minimum(square, rest) >= _MARGIN
            q, _ = self.mechanism.rectangle(lengths, side)
            return q, lengths, self.mechanism.rectangle(goal, side)[1], goal, good
        ways = tuple(self._lengths(stream) for _ in range(_LEGS))
        steps = float(_WALK * self.control.rate)
        design = self.mechanism.design
        q, target, end, moved, fine = evaluate(_walk, design, lengths, side, load, ways, (_LOADED_MARGIN, steps))
        return q, lengths, target, end, good & fine & moved


def _walk(
    design: PlanarFourBarDesign,
    start: Components,
    side: Component,
    load: Components,
    ways: tuple[Components, ...],
    bounds: tuple[float, float],
) -> tuple[Components, Components, Components, Component, Component]:
    """Put the load on, then move the lengths leg by leg.

    Returns the start, the tip and the lengths at the end, whether a leg was taken, and whether the start is fine.
    """
    mechanism = PlanarFourBar(design)
    margin, length = bounds

    def fine(q: Components, lengths: Components, fraction: Component) -> Component:
        stable = mechanism.stability_margin(q, lengths, load) >= margin
        return (fraction >= 1) & stable & (mechanism.wrench_margin(q, lengths, load) >= 0)

    def put_on(q: Components, t: Component) -> Any:
        return mechanism.statics(q, start, tuple(t * force for force in load))

    begin, fraction = continuation(put_on, mechanism.rectangle(start, side)[0])
    good = fine(begin, start, fraction)
    xp = namespace_of(*begin)
    here, lengths, left, moved = begin, start, length, 0.0
    for way in ways:
        gap = xp.maximum(abs(way[0] - lengths[0]), abs(way[1] - lengths[1]))
        share = xp.minimum(1.0, left / xp.maximum(gap, 1e-12))
        new = tuple(d + share * (w - d) for w, d in zip(way, lengths, strict=True))

        def leg(q: Components, t: Component, old: Components = lengths, new: Components = new) -> Any:
            return mechanism.statics(q, tuple(o + t * (n - o) for o, n in zip(old, new, strict=True)), load)

        end, fraction = continuation(leg, here)
        taken = fine(end, new, fraction)
        here = tuple(xp.where(taken, e, h) for e, h in zip(end, here, strict=True))
        lengths = tuple(xp.where(taken, n, d) for n, d in zip(new, lengths, strict=True))
        left = left - xp.where(taken, share * gap, 0.0)
        moved = xp.where(taken, 1.0, moved)
    wrapped = tuple(xp.atan2(xp.sin(angle), xp.cos(angle)) for angle in begin)
    return wrapped, mechanism.tip(here, lengths), lengths, moved > 0, good
