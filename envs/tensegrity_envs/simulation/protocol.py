"""What a simulation is to the environments: states made of components, one function that advances them."""

from typing import Any, NamedTuple, Protocol

from tensegrity_envs.mechanics.namespace import Component, Components

RUNNING, UNSTABLE, WRENCH_INFEASIBLE, BUCKLED, JOINT_LIMIT = range(5)
# Why an episode was terminated; `State.failure` indexes it.
FAILURES = ("", "unstable", "wrench-infeasible", "buckled", "joint limit")


class State(NamedTuple):
    """A manipulator at rest; every component is a float (one environment) or an array of shape (n,).

    Attributes:
        configuration: joint angles [rad].
        inputs: tensions [N].
        tip: position (x, y) [m].
        stability_margin: [-], positive where stable; on failure that of the state that could not be reached.
        wrench_margin: [-], likewise.
        failure: index into FAILURES. The other fields then hold the last state that was stable and wrench-feasible.
    """

    configuration: Components
    inputs: Components
    tip: Components
    stability_margin: Component
    wrench_margin: Component
    failure: Component


class Simulation(Protocol):
    """A way to drive a mechanism. `mechanism` is passed in, since its parameters may differ from episode to episode."""

    action_size: int
    rate: float  # what an action component of 1 adds in one step
    rate_unit: str

    def at(self, mechanism: Any, q: Components, *args: Any, **kwargs: Any) -> State:
        """The state of rest in configuration q, under the inputs that follow where q alone does not fix them."""
        ...

    def start(self, mechanism: Any, q: Components) -> State:
        """The state of an arm that begins in configuration q."""
        ...

    def advance(self, mechanism: Any, state: State, action: Components) -> State:
        """The state one step later.

        Inputs saturate at their bounds; a state that leaves the feasible set is a failure.
        """
        ...
