"""Quasi-static simulation of a spatial prism, driven by the lengths of its struts."""

import math
from typing import Any

from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.mechanics.equilibrium import continuation
from tensegrity_envs.mechanics.spatial_prism import SpatialPrism
from tensegrity_envs.mechanics.spatial_prism.vectors import dot
from tensegrity_envs.simulation.protocol import (
    BUCKLED,
    RUNNING,
    SINGULAR,
    WRENCH_INFEASIBLE,
    Episode,
    State,
)
from tensegrity_envs.simulation.quasi_static import clip, keep_where


class LengthControl:
    """Actions are increments of the struts' lengths; the platform takes its equilibrium above the base.

    Without a load that is known in closed form and translates only; under a load the orientation is followed by
    continuation. Lengths saturate at the struts' stroke. An episode fails ("singular") where the platform comes lower
    than a fifth of the base's radius or the lengths fit no position, ("wrench-infeasible") where a strut would have to
    pull or a cable to push, ("buckled") where the equilibrium is lost; the prism then stays where it was.

    Args:
        prism: nominal.
        loaded: whether there may be a load.
    """

    action_size = 3
    rate_unit = "m"
    resolution = 1 / 512

    def __init__(self, prism: SpatialPrism, loaded: bool) -> None:
        self.rate = 0.03 * float(prism.design.D)
        self.loaded = loaded

    def bounds(self, mechanism: SpatialPrism) -> tuple[Component, Component]:
        """The struts' stroke: from 1 to 2.4 times the base's radius [m]."""
        return mechanism.design.D, 2.4 * mechanism.design.D

    def lowest(self, mechanism: SpatialPrism) -> Component:
        """Height of the centroid at which an episode ends: a fifth of the base's radius [m].

        Above it and within the stroke, no two struts of the unloaded prism touch.
        """
        return 0.2 * mechanism.design.D

    def start(
        self, mechanism: SpatialPrism, episode: Episode, q: Components, inputs: Components | None = None
    ) -> State:
        """See `Simulation.start`."""
        lengths = mechanism.unloaded_lengths(q[:3]) if inputs is None else inputs
        return self._at(mechanism, q, lengths, episode.load_at(0.0 * q[0]), 0.0 * q[0], self.loaded)

    def moved(self, mechanism: SpatialPrism, inputs: Components, action: Components) -> Components:
        """The lengths after an action; they saturate at the struts' stroke."""
        xp = namespace_of(*inputs)
        low, high = self.bounds(mechanism)
        return tuple(clip(xp, length + self.rate * a, low, high) for length, a in zip(inputs, action, strict=True))

    def actuation(self, mechanism: SpatialPrism, inputs: Components) -> Components:
        """The lengths themselves."""
        return inputs

    def coordinates(self, mechanism: SpatialPrism, q: Components, inputs: Components) -> Components:
        """The configuration itself."""
        return q

    def in_motion(
        self,
        mechanism: SpatialPrism,
        u: Components,
        velocity: Components,
        inputs: Components,
        load: Components,
        time: Component,
    ) -> State:
        """See `InputControl.in_motion`; margins are those of the pose of this moment."""
        force = load or (0.0, 0.0, 0.0)
        return self._at(mechanism, u, inputs, force, time, True)._replace(velocity=velocity, failure=RUNNING)

    def failed(self, mechanism: SpatialPrism, state: State, before: State) -> Component:
        """Too low ("singular"), or turned by more than a right angle ("buckled")."""
        xp = namespace_of(*state.configuration)
        z, *turn = state.configuration[2:]
        failure = xp.where(dot(turn, turn) > (0.5 * math.pi) ** 2, BUCKLED, RUNNING)
        return xp.where(z <= self.lowest(mechanism), SINGULAR, failure)

    def _at(
        self,
        mechanism: SpatialPrism,
        q: Components,
        lengths: Components,
        load: Components,
        time: Any,
        turned: bool,
    ) -> State:
        """The state of a prism, turned or not.

        The stability margin is the smaller of the smallest eigenvalue of the reduced Hessian, divided by that at rest,
        and of how far the squared height is above the lowest one, divided by the square of the base's radius.
        """
        D = mechanism.design.D
        xp = namespace_of(*q)
        height = (q[2] * q[2] - self.lowest(mechanism) ** 2) / (D * D)
        if turned:
            stability = xp.minimum(mechanism.stability_margin(q, None, load), height)
            wrench = mechanism.wrench_margin(q, None, load)
        else:
            stability = xp.minimum(height, 1.0)
            shortest = xp.minimum(xp.minimum(lengths[0], lengths[1]), lengths[2])
            wrench = xp.minimum(shortest / D, 1.0)  # thrusts k l, tensions k D
        failure = xp.where(wrench <= 0, WRENCH_INFEASIBLE, RUNNING)
        return State(q, lengths, tuple(q[:3]), stability, wrench, xp.where(height <= 0, SINGULAR, failure), time)

    def advance(self, mechanism: SpatialPrism, episode: Episode, state: State, action: Components) -> State:
        """See `Simulation.advance`."""
        xp = namespace_of(*state.configuration)
        new = self.moved(mechanism, state.inputs, action)
        time = state.time + 1
        if self.loaded:
            reached = self._followed(mechanism, episode, state, new)
        else:
            (x, y), square = mechanism.foot_and_square(new)
            still = 0.0 * x
            q = (x, y, xp.sqrt(xp.maximum(square, 0.0)), still, still, still)
            reached = self._at(mechanism, q, new, (), time, False)
        return keep_where(xp, reached.failure != RUNNING, reached, state)._replace(record=state.record)

    def _followed(self, mechanism: SpatialPrism, episode: Episode, state: State, new: Components) -> State:
        """The equilibrium that the present one becomes while lengths and load change to those of the next step."""
        xp = namespace_of(*state.configuration)
        time = state.time + 1
        load, next_load = episode.load_at(state.time), episode.load_at(time)

        def between(t: Component) -> tuple[Components, Components]:
            lengths = tuple(o + t * (n - o) for o, n in zip(state.inputs, new, strict=True))
            return lengths, tuple(o + t * (n - o) for o, n in zip(load, next_load, strict=True))

        def path(w: Components, t: Component) -> Any:
            return mechanism.statics(w, *between(t))

        w, fraction = continuation(path, state.configuration[3:], self.resolution)
        lengths, force = between(fraction)
        position = mechanism.locked_pose(w, lengths).position
        reached = self._at(mechanism, (*position, *w), lengths, force, time, True)
        lost = fraction < 1
        failure = xp.where(lost & (reached.failure == RUNNING), BUCKLED, reached.failure)
        margin = xp.where(lost, xp.minimum(reached.stability_margin, 0.0), reached.stability_margin)
        return reached._replace(failure=failure, stability_margin=margin)
