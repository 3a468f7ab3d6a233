"""The planar 4-bar mechanism, driven by increments of its actuator lengths."""

import math
from typing import Any

from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.geometry.obstacle_path import Disc
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar
from tensegrity_envs.simulation.floating_lengths import FloatingFourBar, side_of_diagonals
from tensegrity_envs.simulation.protocol import BUCKLED, RUNNING, SINGULAR, WRENCH_INFEASIBLE, Episode, State
from tensegrity_envs.simulation.quasi_static import STEP_SHARE, InputControl, keep_where

STROKE = (0.01, 0.99)  # actuator lengths, as shares of 2 L: at 2 L an actuator has no moment arm
LEAST_STIFFNESS = 0.02  # stability margin below which an unloaded rectangle counts as singular


def stroke(mechanism: PlanarFourBar) -> tuple[Component, Component]:
    """Shortest and longest actuator length [m]."""
    low, high = STROKE
    return 2 * low * mechanism.length, 2 * high * mechanism.length


def is_open(mechanism: PlanarFourBar, lengths: Components, margin: float = LEAST_STIFFNESS) -> Component:
    """Whether unloaded rectangles of these lengths are within the stroke and have at least this stability margin."""
    low, high = stroke(mechanism)
    square, rest = mechanism.flatness(lengths)
    inside = (lengths[0] >= low) & (lengths[0] <= high) & (lengths[1] >= low) & (lengths[1] <= high)
    return inside & (2 * square >= margin) & (2 * rest >= margin)


def around_meeting(mechanism: PlanarFourBar, margin: float) -> Disc:
    """The actuator lengths [m] close to (L, L), where C and D meet and an unloaded rectangle is singular.

    Near there R^2 L^2 = (d1^2 + d2^2 -+ d1 d2) / 0.75 for deviations d: where the stability margin 2 R^2 is less than
    `margin` is an ellipse. The disc is round it.
    """
    length = float(mechanism.length)
    return Disc(length, length, length * math.sqrt(1.5 * margin / 2))


class LoadedLengthControl(InputControl[PlanarFourBar]):
    """Under a force: the mechanism follows its stable equilibrium in (theta, gamma) by continuation.

    Snapping to the other side is a failure ("buckled"), and so is a thrust beyond 2 K L ("wrench-infeasible").
    """

    action_size = 2
    rate_unit = "m"
    ends_infeasible = True

    def __init__(self, mechanism: PlanarFourBar) -> None:
        self.rate = STEP_SHARE * float(mechanism.length)

    def bounds(self, mechanism: PlanarFourBar) -> tuple[Component, Component]:
        """See `stroke`."""
        return stroke(mechanism)

    def statics(self, mechanism: PlanarFourBar, u: Components, inputs: Components, load: Components) -> Any:
        """See `PlanarFourBar.statics`."""
        return mechanism.statics(u, inputs, load)

    def from_coordinates(self, mechanism: PlanarFourBar, u: Components) -> Components:
        """The angles brought back to (-pi, pi]: bars may turn all the way round."""
        xp = namespace_of(*u)
        return tuple(xp.atan2(xp.sin(angle), xp.cos(angle)) for angle in u)

    def margins(
        self, mechanism: PlanarFourBar, q: Components, inputs: Components, load: Components
    ) -> tuple[Component, Component]:
        """Smallest eigenvalue of the Hessian divided by K L^2, and `PlanarFourBar.wrench_margin`."""
        return mechanism.stability_margin(q, inputs, load), mechanism.wrench_margin(q, inputs, load)

    def usual_inputs(self, mechanism: PlanarFourBar, q: Components, load: Components) -> Components:
        """None: the angles alone do not tell the lengths.

        Raises:
            ValueError: always.
        """
        raise ValueError("the planar 4-bar mechanism must be started with its actuator lengths")

    def at_rest(
        self, mechanism: PlanarFourBar, q: Components, inputs: Components, load: Components, time: Component
    ) -> State:
        """See `InputControl.at_rest`."""
        stability, wrench = self.margins(mechanism, q, inputs, load)
        return State(q, inputs, mechanism.tip(q, inputs), stability, wrench, RUNNING, time)

    def advance(self, mechanism: PlanarFourBar, episode: Episode, state: State, action: Components) -> State:
        """See `Simulation.advance`."""
        new = super().advance(mechanism, episode, state, action)
        xp = namespace_of(*state.configuration)
        weak = (new.failure == RUNNING) & (new.wrench_margin < 0)
        return keep_where(xp, weak, new._replace(failure=xp.where(weak, WRENCH_INFEASIBLE, new.failure)), state)


class RectangleControl(LoadedLengthControl):
    """Without a load, in closed form: the rectangle stays on its side of the line CD.

    Coming close to where C and D coincide or where the rectangle becomes flat is a failure ("singular"), and so is a
    thrust beyond 2 K L ("wrench-infeasible").
    """

    def margins(
        self, mechanism: PlanarFourBar, q: Components, inputs: Components, load: Components
    ) -> tuple[Component, Component]:
        """Stability margin 2 min(R^2, 1 - R^2) and `PlanarFourBar.wrench_margin`."""
        square, rest = mechanism.flatness(inputs)
        xp = namespace_of(square)
        return 2 * xp.minimum(square, rest), mechanism.wrench_margin(q, inputs)

    def advance(self, mechanism: PlanarFourBar, episode: Episode, state: State, action: Components) -> State:
        """See `Simulation.advance`."""
        xp = namespace_of(*state.configuration)
        lengths = self.moved(mechanism, state.inputs, action)
        side = xp.where(mechanism.side_of(state.configuration, state.inputs) > 0, 1.0, -1.0)
        q, tip = mechanism.rectangle(lengths, side)
        stability, wrench = self.margins(mechanism, q, lengths, (0.0, 0.0))
        singular = stability < LEAST_STIFFNESS
        failure = xp.where(singular, SINGULAR, xp.where(wrench < 0, WRENCH_INFEASIBLE, RUNNING))
        new = State(q, lengths, tip, stability, wrench, failure, state.time + 1)
        return keep_where(xp, failure != RUNNING, new, state)

    def coordinates(self, mechanism: PlanarFourBar, q: Components, inputs: Components) -> Components:
        """See `FloatingFourBar.coordinates`."""
        return FloatingFourBar(mechanism).coordinates(q, inputs)

    def in_motion(
        self,
        mechanism: PlanarFourBar,
        u: Components,
        velocity: Components,
        inputs: Components,
        load: Components,
        time: Component,
    ) -> State:
        """See `InputControl.in_motion`.

        The tip is where bar CF ends; velocities are those of alpha, beta, theta and gamma. The stability
        margin is that of the Hessian at this moment's configuration, under the commanded lengths.
        """
        arm = FloatingFourBar(mechanism)
        q = arm.configuration(u)
        stability, wrench = LoadedLengthControl.margins(self, mechanism, q, inputs, load)
        return State(q, inputs, arm.tip(u), stability, wrench, RUNNING, time, velocity=arm.rates(velocity))

    def failed(self, mechanism: PlanarFourBar, state: State, before: State) -> Component:
        """Lengths close to a singularity ("singular"), or a snap to the other side of CD ("buckled").

        Which side that is, the bars CF and DE tell; see `side_of_diagonals`.
        """
        xp = namespace_of(*state.configuration)
        square, rest = mechanism.flatness(state.inputs)
        now, then = side_of_diagonals(state.configuration), side_of_diagonals(before.configuration)
        failure = xp.where(now * then < 0, BUCKLED, RUNNING)
        return xp.where(2 * xp.minimum(square, rest) < LEAST_STIFFNESS, SINGULAR, failure)
