"""Episodes of the dual-triangle arm that can be solved."""

from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.checks import checked_range
from tensegrity_envs.mechanics.dual_triangle import DualTriangle, DualTriangleDesign
from tensegrity_envs.mechanics.dual_triangle.inverse import wrap
from tensegrity_envs.mechanics.equilibrium import continuation
from tensegrity_envs.seeding import EpisodeStream, until_found
from tensegrity_envs.simulation.quasi_static import DeltaControl

_SHARE = 0.95  # of joint and input limits: starts and targets stay within
_MIN_MARGIN = 0.02  # stability margin of starts and targets [-]
_LEGS = 3  # of the walk from the start to the target
_FIRST = 20_000  # of the first angles with which a target is looked for
_WALK = 80  # steps that the walk takes at most


class Start(NamedTuple):
    """Configurations [rad], inputs [m] and loads [N] of n arms at rest, and configurations that they can reach."""

    configuration: Components
    inputs: Components
    load: Components
    target_configuration: Components


class Sampler:
    """Draws loads, starts and targets, each a function of (seed, episode) alone.

    Start: a random posture of the unloaded arm, whose control inputs are kept while the load is put on gradually; it
    counts if the arm stays stable and within its limits. Target: where a random walk of the inputs ends, three
    straight legs, at most 80 steps at full rate; a leg that loses stability or ends beyond the limits is not taken. So
    an episode can be solved by that very walk (about one in a thousand passes a joint limit between its corners).

    Args:
        arm: nominal.
        control: its simulation.
        load_range: of the size of the tip force, as multiples of the straight arm's critical load.
    """

    is_traced = False  # see compiler.numbers.Lifting

    def __init__(self, arm: DualTriangle, control: DeltaControl, load_range: tuple[float, float] | None) -> None:
        self.arm, self.control = arm, control
        low, high = checked_range("load_range", load_range, "critical loads")
        self.load_range = (low, high)
        self.critical = float(arm.straight_critical_loads()[0])

    def sample(self, seed: np.ndarray, episode: np.ndarray, design: DualTriangleDesign | None = None) -> Start:
        """Draw the episodes of the given (seed, episode) pairs, both of shape (n,).

        Args:
            seed: of the environments.
            episode: numbers.
            design: of these episodes, if it differs from the nominal one.
        """
        arm = self.arm if design is None else DualTriangle(design, self.arm.segments)
        n, m = len(seed), self.arm.segments
        stream = EpisodeStream(seed, episode)
        size = self.critical * stream.uniform(*self.load_range)
        direction = stream.uniform(-np.pi, np.pi)
        load = np.stack([size * np.cos(direction), size * np.sin(direction)])

        def attempt(owner: np.ndarray, here: EpisodeStream) -> tuple[np.ndarray, np.ndarray]:
            start, delta, target, good = self._try(arm.take(owner), here, tuple(load[:, owner]))
            return np.stack([*start, *delta, *target]), good

        complaint = f"no start found for {self.arm.design} in {{}} draws: lower load_range"
        found = until_found(stream, n, m + _LEGS * m, attempt, complaint)
        q, inputs, goal = (tuple(found[k * m : (k + 1) * m]) for k in range(3))
        return Start(q, inputs, tuple(load), goal)

    def inside(self, arm: DualTriangle, q: Components) -> np.ndarray:
        """Whether the unloaded arm can be held in configurations, within 95 % of the limits of joints and inputs."""
        largest_angle, largest_input, stability = evaluate(_held, arm.design, arm.segments, q)
        high = float(self.control.bounds(self.arm)[1])
        within = (largest_angle <= _SHARE * float(arm.design.joint_limit)) & (largest_input <= _SHARE * high)
        return np.asarray(within & (stability >= _MIN_MARGIN))

    def start_at(self, arm: DualTriangle, posture: Components, load: Components) -> tuple[Components, Components]:
        """Where an arm rests, and under which inputs, that was put into a posture before it was loaded.

        Args:
            arm: a batch of one.
            posture: components of shape (1,) [rad].
            load: likewise [N].

        Raises:
            ValueError: the arm cannot be held there.
        """
        limit, high = float(self.arm.design.joint_limit), float(self.control.bounds(self.arm)[1])
        shown = "configuration (" + ", ".join(f"{float(angle[0]):.6g}" for angle in posture) + ")"
        inputs = self.arm.control(posture)
        if not all(bool((abs(angle) <= limit).all()) for angle in posture):
            raise ValueError(f"{shown}: beyond the joint limits, {limit:.6g} rad")
        if not all(bool((abs(delta) <= high).all()) for delta in inputs):
            raise ValueError(f"{shown}: needs inputs beyond {high:.6g} m")
        steps = _WALK * self.control.rate
        bounds = (limit, _MIN_MARGIN, float(steps))
        q, _, _, fine = evaluate(
            _walk, arm.design, arm.segments, posture, inputs, load, (tuple(inputs),) * _LEGS, bounds
        )
        if not fine.all():
            raise ValueError(f"{shown}: not stable within the joint limits under the load of this episode")
        return q, inputs

    def check_target(self, arm: DualTriangle, target: Components, load: Components) -> None:
        """Refuse a target that no stable posture within the limits holds under the load.

        Raises:
            ValueError: no such posture was found, 721 of the first angle tried (of more than three segments, 20,000 of
                the first angles, at random).
        """
        x, y = (float(component[0]) for component in target)
        high = float(self.control.bounds(self.arm)[1])
        postures = self._postures(x, y)
        count, shown = postures.shape[1], f"target ({x:.6g}, {y:.6g})"
        if not count:
            raise ValueError(f"{shown}: out of reach of the arm within its joint limits")
        q = tuple(postures)
        one = arm.take(np.zeros(count, int))
        force = tuple(np.repeat(component, count) for component in load)
        inputs = one.control(q, force)
        stability = one.stability_margin(q, one.free_lengths(inputs), force)
        holds = np.all([abs(delta) <= high for delta in inputs], axis=0) & (stability > 0)
        if not holds.any():
            raise ValueError(f"{shown}: no stable posture holds it within the inputs' bounds under this episode's load")

    def _postures(self, x: float, y: float) -> np.ndarray:
        """Postures (m, k) [rad] within the joint limits with the tip at (x, y): both elbows of many first angles."""
        limit, free = float(self.arm.design.joint_limit), self.arm.segments - 2
        if free == 1:
            first = np.linspace(-limit, limit, 721)[None]
        else:
            first = np.random.default_rng(0).uniform(-limit, limit, (free, _FIRST if free else 1))
        wrist = self.arm.wrist((np.full(first.shape[1], x), np.full(first.shape[1], y)), tuple(first))
        reached = (wrist.stretch >= 0) & (wrist.folding >= 0)
        found = [
            np.stack([*first, wrap(self.arm.before_last(wrist, last)), last])[:, reached]
            for last in (wrist.angle, -wrist.angle)
        ]
        q = np.concatenate(found, axis=1)
        return q[:, (np.abs(q) <= limit).all(axis=0)]

    def _try(
        self, arm: DualTriangle, stream: EpisodeStream, load: Components
    ) -> tuple[Components, Components, Components, np.ndarray]:
        design, m = arm.design, arm.segments
        limit = _SHARE * float(design.joint_limit)
        posture = tuple(stream.uniform(-limit, limit) for _ in range(m))
        low, high = self.control.bounds(self.arm)
        inputs = self.arm.control(posture)
        allowed = np.all([np.abs(delta) <= _SHARE * high for delta in inputs], axis=0)
        ways = [tuple(stream.uniform(_SHARE * low, _SHARE * high) for _ in range(m)) for _ in range(_LEGS)]
        if not any(self.load_range):
            # Without a load every posture within the limits can be reached from every other.
            goal = self.arm.control(tuple(way * limit / (_SHARE * high) for way in ways[0]))
            ways = [goal] * _LEGS
            allowed &= np.all([np.abs(delta) <= _SHARE * high for delta in goal], axis=0)
        steps = _WALK * self.control.rate
        q, target, moved, fine = evaluate(
            _walk, design, m, posture, inputs, load, tuple(ways), (limit, _MIN_MARGIN, float(steps))
        )
        return q, inputs, target, allowed & fine & moved


def _walk(
    design: DualTriangleDesign,
    segments: int,
    posture: Components,
    inputs: Components,
    load: Components,
    ways: tuple[Components, ...],
    bounds: tuple[float, float, float],
) -> tuple[Components, Components, Component, Component]:
    """Put the load on, then move the inputs leg by leg.

    Returns the start, the end, whether a leg was taken, and whether the start is fine.
    """
    arm = DualTriangle(design, segments)
    limit, margin, length = bounds

    def fine(q: Components, delta: Components, fraction: Component) -> Component:
        stability = arm.stability_margin(q, arm.free_lengths(delta), load)
        return (fraction >= 1) & (stability >= margin) & (limit - _largest(arm, q) >= 0)

    def put_on(q: Components, t: Component) -> Any:
        return arm.statics(q, arm.free_lengths(inputs), tuple(t * force for force in load))

    start, fraction = continuation(put_on, posture)
    good = fine(start, inputs, fraction)
    xp = arm._xp(*posture)
    here, delta, left, moved = start, inputs, length, 0.0
    for way in ways:
        gap = _largest(arm, tuple(w - d for w, d in zip(way, delta, strict=True)))
        share = xp.minimum(1.0, left / xp.maximum(gap, 1e-12))
        new = tuple(d + share * (w - d) for w, d in zip(way, delta, strict=True))

        def leg(q: Components, t: Component, old: Components = delta, new: Components = new) -> Any:
            return arm.statics(q, arm.free_lengths(tuple(o + t * (n - o) for o, n in zip(old, new, strict=True))), load)

        end, fraction = continuation(leg, here)
        taken = fine(end, new, fraction)
        here = tuple(xp.where(taken, e, h) for e, h in zip(end, here, strict=True))
        delta = tuple(xp.where(taken, n, d) for n, d in zip(new, delta, strict=True))
        left = left - xp.where(taken, share * gap, 0.0)
        moved = xp.where(taken, 1.0, moved)
    return start, here, moved > 0, good


def _held(design: DualTriangleDesign, segments: int, q: Components) -> tuple[Component, Component, Component]:
    """Largest angle [rad], largest input [m] and stability margin under the inputs that hold the unloaded arm."""
    arm = DualTriangle(design, segments)
    inputs = arm.control(q)
    return _largest(arm, q), _largest(arm, inputs), arm.stability_margin(q, arm.free_lengths(inputs))


def _largest(arm: DualTriangle, values: Components) -> Component:
    xp = arm._xp(*values)
    largest = abs(values[0])
    for value in values[1:]:
        largest = xp.maximum(largest, abs(value))
    return largest
