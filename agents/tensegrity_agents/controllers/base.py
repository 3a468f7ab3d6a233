"""What the analytic controllers share."""

from typing import Any, TypeVar

import numpy as np

from tensegrity_envs.core import Core
from tensegrity_envs.simulation import Episode

Memory = TypeVar("Memory", bound="tuple[np.ndarray, ...]")


def beginning(count: int, state: Any, episode_start: Any) -> np.ndarray:
    """Which of `count` environments begin an episode, from the arguments of `predict`: all, if these do not say."""
    if state is None or episode_start is None:
        return np.ones(count, bool)
    return np.asarray(episode_start, bool)


def renewed(begins: np.ndarray, new: Memory, old: Memory | None) -> Memory:
    """A memory, a NamedTuple of arrays (n, ...): the new one where an episode begins, elsewhere the old one."""
    if old is None:
        return new
    where = [begins.reshape(-1, *[1] * (part.ndim - 1)) for part in new]
    return type(new)(*(np.where(w, a, b) for w, a, b in zip(where, new, old, strict=True)))


class AnalyticController:
    """Knows the core of its environment and the nominal mechanism; oracles are told the true episodes as well.

    Args:
        core: of the environment.

    Attributes:
        knows: what it is told and measures, for tables.
        rate: largest change of an input in one step.
        nominal: the mechanism of the nominal design.
        privileged: the true episodes, for those that ask for them (see `privileged.Privileged`).
    """

    wants_privileged = False
    knows = ""

    def __init__(self, core: Core) -> None:
        self.core = core
        self.rate = core.simulation.rate
        self.privileged: Episode | None = None
        self._take(core.design)

    def begin_episodes(self, mask: np.ndarray, design: Any, privileged: Episode | None = None) -> None:
        """Take the nominal design and, if this controller asks for it, the true episodes."""
        self._take(design)
        self.privileged = privileged

    def _take(self, design: Any) -> None:
        """Take the nominal design."""
        self.nominal: Any = self.core.mechanism(design)


class Privileged:
    """Mixed into a controller that asks the evaluation for the true episodes."""

    wants_privileged = True

    def begin_episodes(self, mask: np.ndarray, design: Any, privileged: Episode | None = None) -> None:
        """Take the nominal design and the true episodes.

        Raises:
            ValueError: the evaluation did not hand over the true episodes.
        """
        if privileged is None:
            raise ValueError(
                f"{type(self).__name__}: needs the privileged episodes "
                "(evaluate it through tensegrity_agents.evaluation.rollout)"
            )
        super().begin_episodes(mask, design, privileged)  # type: ignore[misc]
