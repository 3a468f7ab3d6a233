"""Actuation of the plain 2-X on the torus: joint increments, and the failure of coming too close to a singularity."""

import math

from tensegrity_envs.compiler.namespace import Component, Components, Namespace, namespace_of
from tensegrity_envs.mechanics.two_x import TwoX
from tensegrity_envs.simulation.protocol import RUNNING, SINGULAR, Episode, State

FULL_TURN = 4 * math.pi  # of alpha: theta = alpha / 2 runs once around


class JointPaths:
    """Actions are increments of theta = alpha / 2 on the torus; there are no cables and no springs.

    A step that comes too close to det J = 0 anywhere on its path is a failure ("singular"), and the arm stays where it
    was.
    """

    action_size = 2
    rate = 0.1
    rate_unit = "rad"
    looks = 8  # along each step

    def __init__(self, smallest: float) -> None:
        self.smallest = smallest

    def start(self, mechanism: TwoX, episode: Episode, q: Components, inputs: Components | None = None) -> State:
        """The state of an arm in configuration q."""
        return self._at(mechanism, q, self.height(mechanism, q), 0.0 * q[0])

    def height(self, mechanism: TwoX, q: Components) -> Component:
        """Det J with respect to theta, divided by L^2."""
        return 4 * mechanism.jacobian_determinant(q) / mechanism.design.l**2

    def _at(self, mechanism: TwoX, q: Components, height: Component, time: Component) -> State:
        return State(q, (), mechanism.tip(q), abs(height) - self.smallest, 1.0 + 0.0 * height, RUNNING, time)

    def advance(self, mechanism: TwoX, episode: Episode, state: State, action: Components) -> State:
        """The state one step later."""
        xp = namespace_of(*state.configuration)
        old = state.configuration
        step = tuple(2 * self.rate * a for a in action)
        before = self.height(mechanism, old)
        lowest: Component = None
        for k in range(1, self.looks + 1):
            here = tuple(o + s * (k / self.looks) for o, s in zip(old, step, strict=True))
            # Negative once the sign has changed
            height = self.height(mechanism, here) * xp.where(before > 0, 1.0, -1.0)
            lowest = height if lowest is None else xp.minimum(lowest, height)
        new = tuple(_wrapped(xp, o + s) for o, s in zip(old, step, strict=True))
        reached = self._at(mechanism, new, lowest, state.time + 1)
        failed = lowest < self.smallest
        clearance = xp.minimum(reached.stability_margin, lowest - self.smallest)
        q = tuple(xp.where(failed, o, n) for o, n in zip(old, new, strict=True))
        tip = tuple(xp.where(failed, o, n) for o, n in zip(state.tip, reached.tip, strict=True))
        return reached._replace(
            configuration=q, tip=tip, stability_margin=clearance, failure=xp.where(failed, SINGULAR, RUNNING)
        )


def _wrapped(xp: Namespace, alpha: Component) -> Component:
    """The same angle in (-2 pi, 2 pi], for angles at most one turn beyond."""
    alpha = xp.where(alpha > FULL_TURN / 2, alpha - FULL_TURN, alpha)
    return xp.where(alpha <= -FULL_TURN / 2, alpha + FULL_TURN, alpha)
