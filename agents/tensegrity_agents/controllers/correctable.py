"""Controllers with feedback whose actions an agent can correct: they go on from what was done, not from what they said.

A controller that follows its own command instead of the measured inputs has to be told where another action was taken,
or else its command leads elsewhere than the arm's inputs.
"""

from abc import abstractmethod
from typing import Any, TypeVar

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController
from tensegrity_envs.compiler.pytree import is_array, tree_leaves
from tensegrity_envs.observation import DecodedObservation

Memory = TypeVar("Memory", bound=tuple[Any, ...])


class Correctable(AnalyticController[Memory]):
    """A controller that can be corrected."""

    @property
    @abstractmethod
    def outlook_size(self) -> int:
        """How many numbers `outlook` has."""

    @abstractmethod
    def given(self, before: Memory, after: Memory, action: np.ndarray) -> Memory:
        """What to remember where another action than the controller's own was taken.

        Args:
            before: what was remembered when the controller was asked.
            after: what it wants to be remembered with its own action.
            action: that was taken, shape (n, action size).
        """

    def added(self, memory: Memory) -> np.ndarray:
        """How far the command is from where the controller alone would have it, in steps of the inputs' rate, shape
        (n, action size). By default no way: wherever the command has come to, it goes on to where it is to be.
        """
        return np.zeros((_count(memory), self.core.simulation.action_size))

    def looks_at_rest(self, memory: Memory) -> np.ndarray:
        """Whether it holds the inputs to identify the arm, shape (n,) of bools: what is added then would mislead it.
        By default it never does.
        """
        return np.zeros(_count(memory), bool)

    @abstractmethod
    def outlook(self, observed: DecodedObservation, memory: Memory) -> np.ndarray:
        """What the controller knows and is about to do, as numbers of about 1, shape (n, outlook_size).

        Args:
            observed: what it was asked about.
            memory: what it wants to be remembered.
        """


def _count(memory: Any) -> int:
    """Of how many environments this is the memory."""
    return len(next(tree_leaves(memory, is_array)))
