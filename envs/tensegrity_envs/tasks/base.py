"""What a task is to the environments: pure functions on components."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Namespace
from tensegrity_envs.simulation.protocol import RUNNING, Episode, State
from tensegrity_envs.tasks.weights import ReachWeights, TrackWeights, Weights

_FULL_MARGIN = 0.2


@dataclass(frozen=True, kw_only=True)
class Task(ABC):
    """What is wanted: when it has been done, what ends an episode besides the mechanics, and what a step is worth.

    Attributes:
        tolerance: the goal is reached within this distance [m or rad].
        reward_type: "dense" or "sparse".
        input_scale: scale of the effort [N or m].
        weights: the weights of the dense reward; each task has its own.
        info_meanings: unit and meaning of the entries of `info` that `metrics` adds.
    """

    goals_decide: ClassVar[bool] = True  # whether the sparse reward depends on the distance alone, without failure
    has_score: ClassVar[bool] = False  # whether episodes go on after success, for a score in `info`

    info_meanings: ClassVar[dict[str, tuple[str, str]]] = {}

    tolerance: float
    reward_type: str = "dense"
    input_scale: float = 1.0
    weights: Weights

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

    @property
    def goal_cycle(self) -> int | None:
        """Steps in which a moving goal comes round; None for goals at rest."""
        return None

    def check_termination(self, xp: Namespace, error: Component, state: State) -> State:
        """The state with the failure that the task itself sees in it; a distance from the goal is none by default."""
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

    def earns_success(self, error: Component, state: State, episode: Episode) -> Component:
        """Whether a step earns the success term of the reward: by default, whether it is within tolerance."""
        return error <= self.tolerance

    def reward_terms(self, xp: Namespace, error: Component, state: State, episode: Episode) -> dict[str, Component]:
        """The weighted terms of the reward by name, each from 0 to its weight; all zero where the episode fails.

        Nothing that is still to come is ever negative: an episode that ends early gives up everything that it could
        still have collected, so that failing early never pays.

        Args:
            xp: namespace of the components.
            error: distance from the goal [m or rad].
            state: after the step.
            episode: what stays the same during it.
        """
        running = xp.where(state.failure == RUNNING, 1.0, 0.0)
        success = xp.where(self.earns_success(error, state, episode), running, 0.0)
        if self.reward_type == "sparse":
            return {"success": success}
        return self.dense_terms(xp, error, state, episode, running, success)

    @abstractmethod
    def dense_terms(
        self, xp: Namespace, error: Component, state: State, episode: Episode, running: Component, success: Component
    ) -> dict[str, Component]:
        """The weighted terms of the dense reward, by the names of its weights.

        Args:
            xp: namespace of the components.
            error: distance from the goal [m or rad].
            state: after the step.
            episode: what stays the same during it.
            running: 1, or 0 where the episode fails in this step.
            success: 1 where the step earns the success term, else 0.
        """

    def remoteness(self, xp: Namespace, error: Component) -> Component:
        """1 + sqrt(error / tolerance): 1 at the goal, 2 at one tolerance from it, 11 at a hundred."""
        return 1.0 + xp.sqrt(error / self.tolerance)

    def margin_terms(
        self, xp: Namespace, weights: ReachWeights | TrackWeights, state: State, running: Component
    ) -> dict[str, Component]:
        """The terms "stability" and "wrench", which rise with the margins, up to their weights at 0.2."""
        return {
            "stability": weights.stability * running * share_of(xp, state.stability_margin, _FULL_MARGIN),
            "wrench": weights.wrench * running * share_of(xp, state.wrench_margin, _FULL_MARGIN),
        }


def share_of(xp: Namespace, margin: Component, full: Component) -> Component:
    """How much of a full margin there is, from 0 to 1."""
    return xp.minimum(xp.maximum(margin / full, 0.0), 1.0)
