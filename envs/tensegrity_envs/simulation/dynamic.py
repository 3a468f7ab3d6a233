"""A mechanism in motion: what its inputs do is simulated, what is told about it is the analytic mechanism's.

A step has three parts: `command` (compiled) moves the inputs, an engine simulates the time that a step takes, and
`finish_step` (compiled) judges where the mechanism is.
"""

from typing import Any, NamedTuple, Protocol

from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.simulation.protocol import DIVERGED, FLIPPED, RUNNING, Episode, State
from tensegrity_envs.simulation.quasi_static import keep_where

LARGEST_ASSEMBLY_ERROR = 0.05  # a flip goes through larger ones, bang-bang inputs stay below 0.02 (docs/mujoco.md)


class Command(NamedTuple):
    """What the engine is told.

    Attributes:
        state: before the step, with the new inputs and the new time.
        actuation: tensions [N], free or actuator lengths [m].
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


class Drivable(Protocol):
    """A quasi-static simulation that tells a dynamic one what its inputs are; see `InputControl`."""

    action_size: int
    rate: float
    rate_unit: str

    def bounds(self, mechanism: Any) -> tuple[Component, Component]:
        """Lowest and highest value of every input."""
        ...

    def moved(self, mechanism: Any, inputs: Components, action: Components) -> Components:
        """The inputs after an action."""
        ...

    def actuation(self, mechanism: Any, inputs: Components) -> Components:
        """What the actuators do under these inputs."""
        ...

    def coordinates(self, mechanism: Any, q: Components, inputs: Components) -> Components:
        """Those of the dynamic simulation, of a mechanism at rest."""
        ...

    def start(self, mechanism: Any, episode: Episode, q: Components, inputs: Components | None = None) -> State:
        """See `Simulation.start`."""
        ...

    def advance(self, mechanism: Any, episode: Episode, state: State, action: Components) -> State:
        """See `Simulation.advance`."""
        ...

    def in_motion(
        self, mechanism: Any, u: Components, velocity: Components, inputs: Components, load: Components, time: Component
    ) -> State:
        """The state of a mechanism that moves."""
        ...

    def failed(self, mechanism: Any, state: State, before: State) -> Component:
        """How a mechanism that moves has failed."""
        ...


def check_smooth(core: Any) -> None:
    """See that the steps of an environment can be differentiated; see `simulation.smooth` and `smooth_rest`.

    Args:
        core: of the environment.

    Raises:
        ValueError: there are obstacles; it is quasi-static and not driven by its inputs, or dynamic with prismatic
            actuators or a platform.
    """
    if core.has_obstacles:
        raise ValueError("environments with obstacles cannot be differentiated yet")
    if core.engine is None:
        from tensegrity_envs.simulation.quasi_static import InputControl

        if not isinstance(core.simulation, InputControl):
            raise ValueError("only quasi-static environments that are driven by inputs can be differentiated yet")
        return
    if core.engine.model.linkage.space != 2 or any(member.kind == "actuator" for member in core.nominal.members):
        raise ValueError("dynamics with prismatic actuators or a platform cannot be differentiated yet")


class DynamicControl:
    """Actions are increments of the inputs, as in a quasi-static simulation; the mechanism follows with its inertia.

    Stability margin and wrench margin are those of the analytic mechanism, held by these inputs where it is at that
    moment: on the way it may pass through states in which it could not rest, which is no failure. Failures are those of
    `Drivable.failed`, a simulation that diverged ("simulation diverged"), and a loop that flips into another assembly
    ("assembly flipped").

    Args:
        control: which inputs there are, and how fast they are.
        joints: how many coordinates there are.
        physics_size: numbers in the engine's state.
    """

    def __init__(self, control: Drivable, joints: int, physics_size: int) -> None:
        self.control = control
        self.action_size, self.rate, self.rate_unit = control.action_size, control.rate, control.rate_unit
        self._joints, self._physics_size = joints, physics_size

    def bounds(self, mechanism: Any) -> tuple[Component, Component]:
        """See `InputControl.bounds`."""
        return self.control.bounds(mechanism)

    def actuation(self, mechanism: Any, inputs: Components) -> Components:
        """See `InputControl.actuation`."""
        return self.control.actuation(mechanism, inputs)

    def coordinates(self, mechanism: Any, q: Components, inputs: Components) -> Components:
        """See `Drivable.coordinates`."""
        return self.control.coordinates(mechanism, q, inputs)

    def start(self, mechanism: Any, episode: Episode, q: Components, inputs: Components | None) -> State:
        """See `Simulation.start`; the engine fills in the physics."""
        state = self.control.start(mechanism, episode, q, inputs)
        return state._replace(velocity=(0.0,) * self._joints, physics=(0.0,) * self._physics_size)

    def command(self, mechanism: Any, episode: Episode, state: State, action: Components) -> Command:
        """What the engine is to simulate."""
        inputs = self.control.moved(mechanism, state.inputs, action)
        time = state.time + 1
        actuation = self.control.actuation(mechanism, inputs)
        load = episode.load_at(time) or (0.0,) * len(state.tip)
        return Command(state._replace(inputs=inputs, time=time), actuation, load)

    def finish_step(self, mechanism: Any, episode: Episode, before: State, motion: Motion) -> State:
        """The state at the end of a step.

        Args:
            mechanism: of the episode.
            episode: its load counts.
            before: `Command.state`.
            motion: what the engine found.
        """
        xp = namespace_of(*motion.configuration)
        load = episode.load_at(before.time)
        state = self.control.in_motion(
            mechanism, motion.configuration, motion.velocity, before.inputs, load, before.time
        )
        failure = self.control.failed(mechanism, state, before)
        failure = xp.where(motion.assembly_error > LARGEST_ASSEMBLY_ERROR, FLIPPED, failure)
        failure = xp.where(motion.diverged > 0, DIVERGED, failure)
        state = state._replace(
            failure=failure,
            physics=motion.physics,
            pending=before.pending,
            noise=before.noise,
            record=before.record,
        )
        return keep_where(xp, failure != RUNNING, state, before)
