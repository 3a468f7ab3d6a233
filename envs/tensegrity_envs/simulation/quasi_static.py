"""Quasi-static simulations: the arm is always in equilibrium, and actions move it slowly from one to the next."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar

from tensegrity_envs.compiler.namespace import Component, Components, Namespace, namespace_of
from tensegrity_envs.mechanics.dual_triangle import DualTriangle
from tensegrity_envs.mechanics.equilibrium import continuation
from tensegrity_envs.mechanics.two_x import TwoX
from tensegrity_envs.simulation.protocol import (
    BUCKLED,
    JOINT_LIMIT,
    RUNNING,
    SLACK,
    UNSTABLE,
    WRENCH_INFEASIBLE,
    Episode,
    State,
)


def clip(xp: Namespace, value: Component, low: Component, high: Component) -> Component:
    """The value within [low, high]."""
    return xp.minimum(xp.maximum(value, low), high)


LARGEST_SLACK = 1.0  # of a cable in motion, in nominal free lengths
STEP_SHARE = 0.05  # of the nominal free length: largest change of a free length in a step


class JointControl:
    """Actions are joint increments; the cables take the stiffest feasible tensions.

    The commanded angles saturate at the joint limits. A command outside the stable wrench-feasible joint space is a
    failure ("wrench-infeasible" or "unstable"), and the arm stays where it was.
    """

    rate = 0.1
    rate_unit = "rad"

    def __init__(self, joints: int = 2) -> None:
        self.action_size = joints

    def start(self, mechanism: TwoX, episode: Episode, q: Components, inputs: Components | None = None) -> State:
        """See `Simulation.start`; the cables always take the stiffest tensions."""
        tensions, stability, wrench, tip = mechanism.posture_and_tip(q)
        xp = namespace_of(stability)
        failure = xp.where(wrench < 0, WRENCH_INFEASIBLE, xp.where(stability <= 0, UNSTABLE, RUNNING))
        return State(q, tensions, tip, stability, wrench, failure, 0.0 * stability)

    def advance(self, mechanism: TwoX, episode: Episode, state: State, action: Components) -> State:
        """See `Simulation.advance`."""
        limit = mechanism.design.joint_limit
        xp = namespace_of(*state.configuration)
        q = tuple(
            clip(xp, angle + self.rate * a, -limit, limit) for angle, a in zip(state.configuration, action, strict=True)
        )
        new = self.start(mechanism, episode, q)._replace(time=state.time + 1)
        return keep_where(xp, new.failure != RUNNING, new, state)


class Driven(Protocol):
    """What the simulations ask of every mechanism; the rest is asked by `InputControl`'s methods for one kind."""

    @property
    def design(self) -> Any:
        """Its parameters."""

    @property
    def tip(self) -> Callable[..., Components]:
        """The position of the tip [m], of the configuration and, where that is not enough, the inputs."""


M = TypeVar("M", bound=Driven)


class InputControl(ABC, Generic[M]):
    """Actions are increments of the mechanism's inputs; the arm follows its stable equilibrium by continuation.

    Inputs saturate at their bounds. Loss of stability on the way is a failure ("buckled"), and so is a joint beyond its
    limit ("joint limit"); the arm is then left in the last stable state. M is the kind of mechanism that is driven.
    """

    action_size: int
    rate: float
    rate_unit: str
    resolution = 1 / 512  # of a step: how closely the last stable state before buckling is found
    ends_infeasible = False  # whether a negative wrench margin ends an episode

    @abstractmethod
    def bounds(self, mechanism: M) -> tuple[Component, Component]:
        """Lowest and highest value of every input."""

    @abstractmethod
    def statics(self, mechanism: M, u: Components, inputs: Components, load: Components) -> Any:
        """Gradient and Hessian of the energy in the coordinates in which the equilibrium is followed."""

    def to_coordinates(self, mechanism: M, q: Components) -> Components:
        """The coordinates of a configuration in which its equilibrium is followed."""
        return q

    def from_coordinates(self, mechanism: M, u: Components) -> Components:
        """The configuration [rad]."""
        return u

    @abstractmethod
    def margins(self, mechanism: M, q: Components, inputs: Components, load: Components) -> tuple[Component, Component]:
        """Stability margin and wrench margin."""

    @abstractmethod
    def usual_inputs(self, mechanism: M, q: Components, load: Components) -> Components:
        """The inputs that hold q."""

    def actuation(self, mechanism: M, inputs: Components) -> Components:
        """What the actuators do under these inputs: tensions [N] or free lengths [m]; here the inputs themselves."""
        return inputs

    def slack(self, mechanism: M, q: Components, inputs: Components) -> Component:
        """By how much a cable that could hang slack does, in nominal free lengths; here none can."""
        return 0.0 * q[0]

    def coordinates(self, mechanism: M, q: Components, inputs: Components) -> Components:
        """Those of the dynamic simulation, of a mechanism at rest."""
        return q

    def in_motion(
        self, mechanism: M, u: Components, velocity: Components, inputs: Components, load: Components, time: Component
    ) -> State:
        """The state of a mechanism that moves.

        Args:
            mechanism: simulated.
            u: coordinates of the simulation.
            velocity: of these.
            inputs: commanded.
            load: at the tip [N].
            time: steps since the episode began.
        """
        return self.at_rest(mechanism, u, inputs, load, time)._replace(velocity=velocity)

    def failed(self, mechanism: M, state: State, before: State) -> Component:
        """How a mechanism in motion has failed: beyond a joint limit ("joint limit"), by a slack cable ("cable slack").

        Args:
            mechanism: simulated.
            state: at the end of a step.
            before: a step earlier, but with the inputs of this step.
        """
        xp = namespace_of(*state.configuration)
        failure = xp.where(self.is_outside(mechanism, state.configuration), JOINT_LIMIT, RUNNING)
        slack = self.slack(mechanism, state.configuration, state.inputs)
        return xp.where(slack > LARGEST_SLACK, SLACK, failure)

    def is_outside(self, mechanism: M, q: Components) -> Component:
        """Whether a configuration is beyond its limits: here, one of its components beyond the design's `joint_limit`.

        Episodes end there ("joint limit"). A mechanism with other limits says so in a subclass.
        """
        outside: Component = abs(q[0]) > mechanism.design.joint_limit
        for angle in q[1:]:
            outside = outside | (abs(angle) > mechanism.design.joint_limit)
        return outside

    def moved(self, mechanism: M, inputs: Components, action: Components) -> Components:
        """The inputs after an action; they saturate at their bounds."""
        low, high = self.bounds(mechanism)
        xp = namespace_of(*inputs)
        return tuple(clip(xp, f + self.rate * a, low, high) for f, a in zip(inputs, action, strict=True))

    def start(self, mechanism: M, episode: Episode, q: Components, inputs: Components | None = None) -> State:
        """See `Simulation.start`."""
        load = episode.load_at(0)
        inputs = self.usual_inputs(mechanism, q, load) if inputs is None else inputs
        return self.at_rest(mechanism, q, inputs, load, 0.0 * q[0])

    def at_rest(self, mechanism: M, q: Components, inputs: Components, load: Components, time: Component) -> State:
        """The state in a configuration that these inputs hold."""
        stability, wrench = self.margins(mechanism, q, inputs, load)
        return State(q, inputs, mechanism.tip(q), stability, wrench, RUNNING, time)

    def advance(self, mechanism: M, episode: Episode, state: State, action: Components) -> State:
        """See `Simulation.advance`."""
        xp = namespace_of(*state.configuration)
        old, new = state.inputs, self.moved(mechanism, state.inputs, action)
        time = state.time + 1
        load, next_load = episode.load_at(state.time), episode.load_at(time)
        ramp = bool(episode.load_rate)

        def between(t: Component) -> tuple[Components, Components]:
            inputs = tuple(o + t * (n - o) for o, n in zip(old, new, strict=True))
            return inputs, tuple(o + t * (n - o) for o, n in zip(load, next_load, strict=True)) if ramp else load

        def path(u: Components, t: Component) -> Any:
            return self.statics(mechanism, u, *between(t))

        u, fraction = continuation(path, self.to_coordinates(mechanism, state.configuration), self.resolution)
        q = self.from_coordinates(mechanism, u)
        reached = self.at_rest(mechanism, q, *between(fraction), time)
        outside = self.is_outside(mechanism, q)
        buckled = fraction < 1
        failure = xp.where(outside, JOINT_LIMIT, xp.where(buckled, BUCKLED, RUNNING))  # the limit was passed first
        # What buckles has lost its stiffness, whatever little was left at the last stable point.
        stability = xp.where(buckled, xp.minimum(reached.stability_margin, 0.0), reached.stability_margin)
        reached = reached._replace(failure=failure, stability_margin=stability)
        return keep_where(xp, outside, reached, state)


class TensionControl(InputControl[TwoX]):
    """Arms of X-joints, driven by increments of their cable tensions: of the 2-X four."""

    rate = 15.0
    rate_unit = "N"

    def __init__(self, cables: int = 4) -> None:
        self.action_size = cables

    def bounds(self, mechanism: TwoX) -> tuple[Component, Component]:
        """Lowest and highest tension [N]."""
        return mechanism.design.min_tension, mechanism.design.max_tension

    def statics(self, mechanism: TwoX, u: Components, inputs: Components, load: Components) -> Any:
        """See `TwoX.sine_statics`."""
        return mechanism.sine_statics(u, inputs)

    def to_coordinates(self, mechanism: TwoX, q: Components) -> Components:
        """See `TwoX.to_sines`."""
        return mechanism.to_sines(q)

    def from_coordinates(self, mechanism: TwoX, u: Components) -> Components:
        """See `TwoX.from_sines`."""
        return mechanism.from_sines(u)

    def margins(
        self, mechanism: TwoX, q: Components, inputs: Components, load: Components
    ) -> tuple[Component, Component]:
        """Those of the actual tensions."""
        return mechanism.stability_margin(q, inputs), mechanism.wrench_margin(q, inputs)

    def usual_inputs(self, mechanism: TwoX, q: Components, load: Components) -> Components:
        """The stiffest tensions [N]."""
        return mechanism.stiffest_tensions(q)


class DeltaControl(InputControl[DualTriangle]):
    """The dual-triangle arm, driven by increments of its control inputs delta, one for each segment."""

    def __init__(self, arm: DualTriangle) -> None:
        self.action_size = arm.segments
        self.rate = STEP_SHARE * float(arm.design.nominal_length)
        self.rate_unit = "m"

    def bounds(self, mechanism: DualTriangle) -> tuple[Component, Component]:
        """Within these, no free length is negative [m]."""
        largest = mechanism.design.shortest_length
        return -largest, largest

    def actuation(self, mechanism: DualTriangle, inputs: Components) -> Components:
        """The free lengths [m] that the inputs stand for."""
        return mechanism.free_lengths(inputs)

    def slack(self, mechanism: DualTriangle, q: Components, inputs: Components) -> Component:
        """See `InputControl.slack`; bilateral springs push instead."""
        most: Component = 0.0 * q[0]
        if mechanism.design.springs == "cable":
            xp = namespace_of(*q)
            lengths = mechanism.spring_lengths(q)
            for length, free in zip(lengths, self.actuation(mechanism, inputs), strict=True):
                most = xp.maximum(most, (free - length) / mechanism.design.nominal_length)
        return most

    def statics(self, mechanism: DualTriangle, u: Components, inputs: Components, load: Components) -> Any:
        """See `DualTriangle.statics`."""
        return mechanism.statics(u, self.actuation(mechanism, inputs), load)

    def margins(
        self, mechanism: DualTriangle, q: Components, inputs: Components, load: Components
    ) -> tuple[Component, Component]:
        """Stability margin; and, as the wrench margin, the smaller of two distances: of the inputs to their bounds,
        divided by the nominal free length, and of the joint angles to their limit, divided by that limit.
        """
        low, high = self.bounds(mechanism)
        xp = namespace_of(*inputs, *q)
        slack: Component = None
        for value in inputs:
            here = xp.minimum(value - low, high - value)
            slack = here if slack is None else xp.minimum(slack, here)
        stability = mechanism.stability_margin(q, self.actuation(mechanism, inputs), load)
        room = xp.minimum(
            slack / mechanism.design.nominal_length, mechanism.limit_margin(q) / mechanism.design.joint_limit
        )
        return stability, room

    def usual_inputs(self, mechanism: DualTriangle, q: Components, load: Components) -> Components:
        """Those of the control law [m]."""
        return mechanism.control(q, load)


class FreeLengthControl(DeltaControl):
    """The dual-triangle arm, driven by increments of all its free lengths: co-contraction included."""

    highest = 1.5  # times the nominal free length

    def __init__(self, arm: DualTriangle) -> None:
        super().__init__(arm)
        self.action_size = 2 * arm.segments

    def bounds(self, mechanism: DualTriangle) -> tuple[Component, Component]:
        """From zero to 1.5 times the nominal free length [m]."""
        return 0.0, self.highest * mechanism.design.nominal_length

    def actuation(self, mechanism: DualTriangle, inputs: Components) -> Components:
        """The inputs themselves."""
        return inputs

    def usual_inputs(self, mechanism: DualTriangle, q: Components, load: Components) -> Components:
        """Those of the control law [m]."""
        return mechanism.free_lengths(mechanism.control(q, load))


def keep_where(xp: Namespace, failed: Component, new: State, old: State) -> State:
    """Configuration, inputs and tip of the failed are those before the step."""

    def choose(before: Components, after: Components) -> Components:
        return tuple(xp.where(failed, b, a) for b, a in zip(before, after, strict=True))

    return new._replace(
        configuration=choose(old.configuration, new.configuration),
        inputs=choose(old.inputs, new.inputs),
        tip=choose(old.tip, new.tip),
    )
