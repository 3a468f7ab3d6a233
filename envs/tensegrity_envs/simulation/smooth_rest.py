"""Quasi-static steps of mechanisms driven by their inputs, as equations that can be differentiated.

The environment follows the equilibrium by continuation, which finds where it is lost. Here Newton's method leads from
the configuration before to the equilibrium under the new inputs, half the way first; the last step of it alone is
differentiated, which gives the derivative of the equilibrium itself (implicit function theorem):

    du / d inputs = -H^-1 d g / d inputs,    g = dV/du, H = d2V/du2.

A step fails where Newton's method does not arrive, a pivot of H is not positive, or a joint is beyond its limit; the
mechanism then stays where it was. Arrays are those of JAX.
"""

from typing import Any

import jax
import jax.numpy as jnp

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.equilibrium import solve_symmetric
from tensegrity_envs.simulation.protocol import BUCKLED, JOINT_LIMIT, RUNNING, WRENCH_INFEASIBLE, Episode, State
from tensegrity_envs.simulation.quasi_static import InputControl, keep_where

_PARTS, _ITERATIONS = 2, 3  # of a step; of Newton's method in each part
_LARGEST = 0.5  # change of a coordinate in a step: farther is another equilibrium
_ARRIVED = 1e-3  # last change of a coordinate: what is larger has not converged


class SmoothRest:
    """The step of a quasi-static environment as a function of JAX's arrays.

    Args:
        core: of an environment whose simulation is an `InputControl`.
    """

    def __init__(self, core: Any) -> None:
        assert isinstance(core.simulation, InputControl)
        self.core, self.control = core, core.simulation

    def step(self, episode: Episode, state: State, action: Components) -> tuple[Any, Component]:
        """The outcome one step later, and how far it is from losing its equilibrium.

        Returns:
            The outcome, nothing of which is differentiated by way of the margins; and the stability margin, which
            changes as the smallest pivot of H does, zero where the step has failed; or the wrench margin, if that is
            smaller and ends episodes.
        """
        action, state = self.core.delayed(episode, state, action)
        new, room = self._moved(self.core.mechanism(episode.design), episode, state, action)
        new = new._replace(pending=state.pending, noise=state.noise, record=state.record)
        return self.core.outcome(episode, self.core.with_clearance(episode, state, new)), room

    def _moved(self, mechanism: Any, episode: Episode, state: State, action: Components) -> tuple[State, Component]:
        control, still = self.control, jax.lax.stop_gradient
        old, new = state.inputs, control.moved(mechanism, state.inputs, action)
        time = state.time + 1
        load = episode.load_at(time)
        start = still(tuple(control.to_coordinates(mechanism, state.configuration)))
        u, ends = start, still((old, new))
        for part in range(1, _PARTS + 1):
            inputs = tuple(o + (part / _PARTS) * (n - o) for o, n in zip(*ends, strict=True))
            for _ in range(_ITERATIONS):
                u, change, _ = self._newton(mechanism, u, inputs, load)
        u, change, pivot = self._newton(mechanism, still(u), new, load, is_last=True)
        away = jnp.max(jnp.abs(jnp.stack([still(a) - b for a, b in zip(u, start, strict=True)])), axis=0)
        last = jnp.max(jnp.abs(jnp.stack([still(c) for c in change])), axis=0)
        lost = ~((away < _LARGEST) & (last < _ARRIVED) & (pivot > 0))
        u = tuple(jnp.where(lost, b, a) for a, b in zip(u, start, strict=True))
        q = control.from_coordinates(mechanism, u)
        reached = control.at_rest(mechanism, q, new, load, time)
        stability, wrench = still(reached.stability_margin), still(reached.wrench_margin)
        failure = jnp.where(control.is_outside(mechanism, q), JOINT_LIMIT, RUNNING)
        if control.ends_infeasible:
            failure = jnp.where(wrench < 0, WRENCH_INFEASIBLE, failure)
        failure = jnp.where(lost, BUCKLED, failure)
        margin = reached.wrench_margin
        reached = reached._replace(stability_margin=stability, wrench_margin=wrench, failure=failure)
        positive = jnp.where(lost, 1.0, pivot)
        room = jnp.where(lost, 0.0, stability * positive / still(positive))
        if control.ends_infeasible:
            room = jnp.minimum(room, margin)
        return keep_where(jnp, failure != RUNNING, reached, state), room

    def _newton(
        self, mechanism: Any, u: Components, inputs: Components, load: Components, is_last: bool = False
    ) -> tuple[Components, Components, Component]:
        """A step of Newton's method, the change, and the smallest pivot of H, which is differentiated where it counts.

        Of the last step, H is differentiated for its pivot alone: in the change it only multiplies a gradient of zero.
        """
        gradient, hessian = self.control.statics(mechanism, u, inputs, load)
        fixed = jax.lax.stop_gradient(hessian)
        change, _, _ = solve_symmetric(fixed, gradient)
        moved = tuple(a - c for a, c in zip(u, change, strict=True))
        if not is_last:
            moved = jax.lax.stop_gradient(moved)
            return moved, change, 0.0
        _, again = self.control.statics(mechanism, moved, inputs, load)
        _, pivot, _ = solve_symmetric(again, gradient)
        return moved, change, pivot
