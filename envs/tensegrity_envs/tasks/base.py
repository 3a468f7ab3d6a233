"""What a task is to the environments: pure functions on components."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.simulation.protocol import RUNNING, Episode, State


@dataclass(frozen=True, kw_only=True)
class Task(ABC):
    """What is wanted: when it has been done, what ends an episode besides the mechanics, and what a step is worth.

    Attributes:
        tolerance: the goal is reached within this distance [m or rad].
        reward_type: "dense" or "sparse".
        input_scale: scale of the effort [N or m].
    """

    goals_decide: ClassVar[bool] = True  # whether the sparse reward depends on the distance alone, without failure

    tolerance: float
    reward_type: str = "dense"
    input_scale: float = 1.0

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: an unknown reward type, or a tolerance that is not positive.
        """
        if self.reward_type not in ("dense", "sparse"):
            raise ValueError(f"reward_type = {self.reward_type!r}: must be 'dense' or 'sparse'")
        is_number = isinstance(self.tolerance, int | float | np.number) and not isinstance(self.tolerance, bool)
        if not (is_number and np.isfinite(self.tolerance) and self.tolerance > 0):
            raise ValueError(f"tolerance = {self.tolerance!r}: must be a positive number")

    def is_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether the task is done, as things are: within tolerance, in a state without failure."""
        return (error <= self.tolerance) & (state.failure == RUNNING)

    def check_termination(self, xp: Any, error: Component, state: State) -> State:
        """The state with the failure that the task itself sees in it; being away from the goal is none."""
        return state

    def metrics(self, state: State, episode: Episode) -> dict[str, Component]:
        """Further entries of `info`."""
        return {}

    def effort(self, state: State) -> Component:
        """Mean over the inputs of (input / scale)^2."""
        total: Component = 0.0
        for value in state.inputs:
            total = total + value * value
        return total / (max(len(state.inputs), 1) * self.input_scale**2)

    @abstractmethod
    def reward_terms(self, xp: Any, error: Component, state: State, episode: Episode) -> dict[str, Component]:
        """The weighted terms of the reward by name; none is negative, all are zero where the episode fails."""
