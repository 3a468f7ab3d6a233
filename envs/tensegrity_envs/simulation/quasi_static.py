"""Quasi-static simulations: the arm is always in equilibrium, and actions move it slowly from one to the next."""

from typing import Any

import numpy as np

from tensegrity_envs.mechanics.equilibrium import follow
from tensegrity_envs.mechanics.namespace import Component, Components, namespace_of
from tensegrity_envs.mechanics.two_x import TwoX
from tensegrity_envs.simulation.protocol import BUCKLED, JOINT_LIMIT, RUNNING, UNSTABLE, WRENCH_INFEASIBLE, State


def _clip(xp: Any, value: Component, low: float, high: float) -> Component:
    return xp.minimum(xp.maximum(value, low), high)


class JointControl:
    """Actions are joint increments; the cables take the stiffest feasible tensions.

    The commanded angles saturate at the joint limits. A command outside the stable wrench-feasible joint space is a
    failure, and the arm stays where it was.
    """

    action_size = 2
    rate = 0.1
    rate_unit = "rad"

    def at(self, mechanism: TwoX, q: Components) -> State:
        """The state of rest in configuration q, with the stiffest tensions."""
        tensions, stability, wrench, tip = mechanism.posture_and_tip(q)
        xp = namespace_of(stability)
        failure = xp.where(wrench < 0, WRENCH_INFEASIBLE, xp.where(stability <= 0, UNSTABLE, RUNNING))
        return State(q, tensions, tip, stability, wrench, failure)

    def start(self, mechanism: TwoX, q: Components) -> State:
        """The state of an arm that begins in configuration q."""
        return self.at(mechanism, q)

    def advance(self, mechanism: TwoX, state: State, action: Components) -> State:
        """See `Simulation.advance`."""
        limit = mechanism.design.joint_limit
        xp = namespace_of(*state.configuration)
        q = tuple(
            _clip(xp, angle + self.rate * a, -limit, limit)
            for angle, a in zip(state.configuration, action, strict=True)
        )
        new = self.at(mechanism, q)
        return _keep_where_failed(xp, new, state)


class TensionControl:
    """Actions are tension increments; the arm follows its stable equilibrium by continuation.

    Tensions saturate at their bounds. Loss of stability on the way is a failure ("buckled"), and so is a joint beyond
    its limit; the arm is then left in the last stable state.
    """

    action_size = 4
    rate = 15.0
    rate_unit = "N"
    resolution = 1 / 64  # of a step: how closely the last stable state before buckling is found

    def at(self, mechanism: TwoX, q: Components, tensions: Components) -> State:
        """The state of an arm in stable equilibrium at q under these tensions."""
        stability = mechanism.stability_margin(q, tensions)
        wrench = mechanism.wrench_margin(q, tensions)
        failure = np.full(q[0].shape, RUNNING) if isinstance(q[0], np.ndarray) else RUNNING
        return State(q, tensions, mechanism.tip(q), stability, wrench, failure)

    def start(self, mechanism: TwoX, q: Components) -> State:
        """The state of an arm that begins in configuration q, held by the stiffest tensions."""
        return self.at(mechanism, q, mechanism.stiffest_tensions(q))

    def advance(self, mechanism: TwoX, state: State, action: Components) -> State:
        """See `Simulation.advance`."""
        design = mechanism.design
        xp = namespace_of(*state.configuration)
        old = state.inputs
        new = tuple(
            _clip(xp, f + self.rate * a, design.min_tension, design.max_tension)
            for f, a in zip(old, action, strict=True)
        )

        def path(u: Components, t: Component, index: Any) -> Any:
            if index is None:
                return mechanism.sine_statics(u, new)
            between = tuple(_at(o, index) + t * (_at(n, index) - _at(o, index)) for o, n in zip(old, new, strict=True))
            return mechanism.take(index).sine_statics(u, between)

        u, fraction = follow(path, mechanism.to_sines(state.configuration), self.resolution)
        q = mechanism.from_sines(u)
        reached = self.at(mechanism, q, tuple(o + fraction * (n - o) for o, n in zip(old, new, strict=True)))
        outside = (abs(q[0]) > design.joint_limit) | (abs(q[1]) > design.joint_limit)
        buckled = fraction < 1.0
        failure = xp.where(outside, JOINT_LIMIT, xp.where(buckled, BUCKLED, RUNNING))  # the limit was passed first
        # What buckles has lost its stiffness, whatever little was left at the last stable point.
        stability = xp.where(buckled, xp.minimum(reached.stability_margin, 0.0), reached.stability_margin)
        reached = reached._replace(failure=failure, stability_margin=stability)
        return _keep_where_failed(xp, reached, state, outside)


def _keep_where_failed(xp: Any, new: State, old: State, failed: Component = None) -> State:
    """Replace configuration, inputs and tip of the failed by those before the step."""
    failed = new.failure != RUNNING if failed is None else failed
    if isinstance(failed, bool):
        return new._replace(configuration=old.configuration, inputs=old.inputs, tip=old.tip) if failed else new

    def choose(before: Components, after: Components) -> Components:
        return tuple(xp.where(failed, b, a) for b, a in zip(before, after, strict=True))

    return new._replace(
        configuration=choose(old.configuration, new.configuration),
        inputs=choose(old.inputs, new.inputs),
        tip=choose(old.tip, new.tip),
    )


def _at(values: Component, index: Any) -> Component:
    return values[index] if isinstance(values, np.ndarray) else values
