"""What a simulation is to the environments: states made of components, one function that advances them."""

import math
from typing import Any, NamedTuple, Protocol

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, Namespace, namespace_of, to_single

RUNNING, UNSTABLE, WRENCH_INFEASIBLE, BUCKLED, JOINT_LIMIT, OFF_TARGET, SINGULAR = range(7)
DIVERGED, FLIPPED, SLACK, COLLISION = range(7, 11)
# Why an episode was terminated; `State.failure` indexes it.
FAILURES = (
    "",
    "unstable",
    "wrench-infeasible",
    "buckled",
    "joint limit",
    "off target",
    "singular",
    "simulation diverged",
    "assembly flipped",
    "cable slack",
    "collision",
)


def termination_reason(failure: Any) -> Any:
    """Why an episode was terminated, in words.

    Args:
        failure: info["failure"]: a number, or an array of them (of a vector environment).

    Returns:
        A string, or an array of strings of the same shape; "" where the episode was not terminated.
    """
    words = np.array(FAILURES, object)[failure]
    return words if isinstance(words, np.ndarray) else str(words)


class State(NamedTuple):
    """A manipulator: at rest in the quasi-static simulations, in motion in the dynamic ones.

    Attributes:
        configuration: joint angles [rad].
        inputs: tensions [N] or free lengths [m].
        tip: position (x, y) or (x, y, z) [m].
        stability_margin: [-], positive where stable; on failure that of the state that could not be reached.
        wrench_margin: [-], likewise: how far tensions (of the dual-triangle: free lengths and joint angles) are from
            their bounds.
        failure: index into FAILURES. The other fields then hold the last state that was stable and wrench-feasible.
        time: steps since the episode began.
        record: what the task remembers of the steps before; nothing, in most.
        velocity: joint rates [rad/s]; none in the quasi-static simulations.
        physics: from which a dynamic simulation goes on; none in the quasi-static ones.
        pending: actions that have been given and not yet been taken, the newest first; none without a delay.
        noise: of the sensors, in standard deviations; none without noise.
        clearance: the least from any obstacle in the last step [m]; on a collision, that of what could not be reached.
            None without obstacles.
    """

    configuration: Components
    inputs: Components
    tip: Components
    stability_margin: Component
    wrench_margin: Component
    failure: Component
    time: Component
    record: Components = ()
    velocity: Components = ()
    physics: Components = ()
    pending: tuple[Components, ...] = ()
    noise: Components = ()
    clearance: Component = None


class Episode(NamedTuple):
    """What stays the same during an episode.

    Attributes:
        design: of the mechanism, with its true parameters.
        load: dead force at the tip (fx, fy) or (fx, fy, fz) [N].
        load_rate: what is added to it in every step [N].
        goal: target position (x, y) or (x, y, z) [m], as float32 numbers; of a moving goal, its mean.
        solutions: feasible configurations (or inputs, see `tasks.InputReach`) that put the tip there, for the reward;
            none in the sparse form.
        random: what was randomized, by name; see `randomization.Randomization`.
        onset: step from which on the load acts; None for the first one.
        motion: of a moving goal, the amplitudes of its harmonics [m], for every axis (cosine 1, sine 1, cosine 2, ...);
            none for a goal at rest.
        cycle: steps in which a moving goal comes round.
        obstacles: what the arm must not touch; see `geometry.clearance`.
    """

    design: Any
    load: Components
    load_rate: Components
    goal: Components
    solutions: tuple[Components, ...] = ()
    random: dict[str, Component] = {}  # noqa: RUF012  (never changed)
    onset: Component = None
    motion: tuple[Components, ...] = ()
    cycle: int = 1
    obstacles: tuple[Any, ...] = ()

    def load_at(self, time: Component) -> Components:
        """The load after so many steps [N]."""
        if self.onset is not None:
            xp = namespace_of(time, self.onset)
            return tuple(xp.where(time >= self.onset, force, 0.0) for force in self.load)
        if not self.load_rate:
            return self.load
        return tuple(force + time * rate for force, rate in zip(self.load, self.load_rate, strict=True))

    def goal_at(self, time: Component) -> Components:
        """The goal after so many steps [m], as float32 numbers."""
        if not self.motion:
            return self.goal
        waves = waves_at(namespace_of(time, *self.goal), time, self.cycle, len(self.motion[0]) // 2)
        moved = []
        for mean, amplitudes in zip(self.goal, self.motion, strict=True):
            goal = mean
            for wave, amplitude in zip(waves, amplitudes, strict=True):
                goal = goal + wave * amplitude
            moved.append(to_single(goal))
        return tuple(moved)


def waves_at(xp: Namespace, time: Component, cycle: int, harmonics: int) -> list[Component]:
    """Cosine 1, sine 1, cosine 2, ... after so many steps: what `Episode.motion` has the amplitudes of."""
    waves: list[Component] = []
    for k in range(1, harmonics + 1):
        angle = 2 * math.pi * k * time / cycle
        waves += [xp.cos(angle), xp.sin(angle)]
    return waves


class Simulation(Protocol):
    """A way to drive a mechanism: pure functions on components."""

    action_size: int
    rate: float  # what an action component of 1 adds in one step
    rate_unit: str

    def start(self, mechanism: Any, episode: Episode, q: Components, inputs: Components | None) -> State:
        """The state of an arm that begins at rest in q, under these inputs or, if None, the usual ones."""
        ...

    def advance(self, mechanism: Any, episode: Episode, state: State, action: Components) -> State:
        """The state one step later.

        Inputs saturate at their bounds; a state that leaves the feasible set is a failure.
        """
        ...
