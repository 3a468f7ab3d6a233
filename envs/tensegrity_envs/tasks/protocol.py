"""What a task is to the environments: pure functions on components."""

from typing import Any, Protocol

from tensegrity_envs.mechanics.namespace import Component
from tensegrity_envs.simulation.protocol import Episode, State


class Task(Protocol):
    """What is wanted: when it has been done, what ends an episode besides the mechanics, and what a step is worth.

    Attributes:
        tolerance: the tip is on target within this distance [m].
        reward_type: "dense" or "sparse".
    """

    @property
    def tolerance(self) -> float:
        """See above."""
        ...

    @property
    def reward_type(self) -> str:
        """See above."""
        ...

    def is_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether the task is done, as things are."""
        ...

    def judge(self, xp: Any, error: Component, state: State) -> State:
        """The state with the failure that the task itself sees in it."""
        ...

    def measures(self, state: State, episode: Episode) -> dict[str, Component]:
        """Further entries of `info`."""
        ...

    def effort(self, state: State) -> Component:
        """How much the inputs cost."""
        ...

    def reward_terms(self, xp: Any, error: Component, state: State, episode: Episode) -> dict[str, Component]:
        """The weighted terms of the reward by name; none is negative, all are zero where the episode fails."""
        ...
