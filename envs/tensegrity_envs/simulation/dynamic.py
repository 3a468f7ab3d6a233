"""A mechanism in motion: what its inputs do is simulated, what is told about it is the analytic mechanism's.

A step has three parts: `command` (compiled) moves the inputs, an engine simulates the time that a step takes, and
`arrive` (compiled) judges where the mechanism is.
"""

from typing import Any, NamedTuple

from tensegrity_envs.mechanics.namespace import Component, Components, namespace_of
from tensegrity_envs.simulation.protocol import DIVERGED, FLIPPED, JOINT_LIMIT, RUNNING, SLACK, Episode, State
from tensegrity_envs.simulation.quasi_static import InputControl, keep_where

LARGEST_ASSEMBLY_ERROR = 0.05  # a flip goes through larger ones, bang-bang inputs stay below 0.02 (docs/mujoco.md)
LARGEST_SLACK = 1.0  # of a cable, in nominal free lengths


class Command(NamedTuple):
    """What the engine is told.

    Attributes:
        state: before the step, with the new inputs and the new time.
        actuation: tensions [N] or free lengths [m].
        load: at the tip [N].
    """

    state: State
    actuation: Components
    load: Components


class Motion(NamedTuple):
    """What the engine found at the end of a step.

    Attributes:
        configuration: joint angles [rad].
        velocity: their rates [rad/s].
        physics: from which the simulation goes on.
        diverged: whether it did; all others are then those from before.
        assembly_error: of the loops [-].
    """

    configuration: Components
    velocity: Components
    physics: Components
    diverged: Component
    assembly_error: Component


class DynamicControl:
    """Actions are increments of the inputs, as in a quasi-static simulation; the mechanism follows with its inertia.

    Stability margin and wrench margin are those of the analytic mechanism, held by these inputs where it is at that
    moment: on the way it may pass through states in which it could not rest, which is no failure. Failures are a joint
    beyond its limit, a simulation that diverged, a loop that flips into another assembly, and a cable slack by more
    than its nominal free length.

    Args:
        control: which inputs there are, and how fast they are.
        joints: how many angles there are.
        physics_size: numbers in the engine's state.
    """

    def __init__(self, control: InputControl, joints: int, physics_size: int) -> None:
        self.control = control
        self.action_size, self.rate, self.rate_unit = control.action_size, control.rate, control.rate_unit
        self._joints, self._physics_size = joints, physics_size

    def bounds(self, mechanism: Any) -> tuple[Component, Component]:
        """See `InputControl.bounds`."""
        return self.control.bounds(mechanism)

    def actuation(self, mechanism: Any, inputs: Components) -> Components:
        """See `InputControl.actuation`."""
        return self.control.actuation(mechanism, inputs)

    def start(self, mechanism: Any, episode: Episode, q: Components, inputs: Components | None) -> State:
        """See `Simulation.start`; the engine fills in the physics."""
        state = self.control.start(mechanism, episode, q, inputs)
        return state._replace(velocity=(0.0,) * self._joints, physics=(0.0,) * self._physics_size)

    def command(self, mechanism: Any, episode: Episode, state: State, action: Components) -> Command:
        """What the engine is to simulate."""
        inputs = self.control.moved(mechanism, state.inputs, action)
        time = state.time + 1
        actuation = self.control.actuation(mechanism, inputs)
        return Command(state._replace(inputs=inputs, time=time), actuation, episode.load_at(time))

    def arrive(self, mechanism: Any, episode: Episode, before: State, motion: Motion) -> State:
        """The state at the end of a step.

        Args:
            mechanism: of the episode.
            episode: its load counts.
            before: `Command.state`.
            motion: what the engine found.
        """
        q, inputs = motion.configuration, before.inputs
        xp = namespace_of(*q)
        state = self.control.at_rest(mechanism, q, inputs, episode.load_at(before.time), before.time)
        outside: Component = abs(q[0]) > mechanism.design.joint_limit
        for angle in q[1:]:
            outside = outside | (abs(angle) > mechanism.design.joint_limit)
        failure = xp.where(outside, JOINT_LIMIT, RUNNING)
        slack = self.control.slack(mechanism, q, inputs)
        failure = xp.where(slack > LARGEST_SLACK, SLACK, failure)
        failure = xp.where(motion.assembly_error > LARGEST_ASSEMBLY_ERROR, FLIPPED, failure)
        failure = xp.where(motion.diverged > 0, DIVERGED, failure)
        state = state._replace(
            failure=failure,
            velocity=motion.velocity,
            physics=motion.physics,
            pending=before.pending,
            noise=before.noise,
            record=before.record,
        )
        return keep_where(xp, failure != RUNNING, state, before)
