"""Pictures of a vector environment: one for each of its environments."""

from typing import Any

import numpy as np

from tensegrity_envs.core import Core
from tensegrity_envs.rendering import draw

_TRACE = 100  # tip positions kept for the pictures


class Tiles:
    """Draws all environments of a batch, each with the trace of its tip.

    Args:
        core: of the environments.
        num_envs: how many there are.
        size: width and height of a picture [pixels].
    """

    def __init__(self, core: Core, num_envs: int, size: tuple[int, int]) -> None:
        self._core, self._size = core, size
        self._traces: list[list[tuple[float, ...]]] = [[] for _ in range(num_envs)]
        self._pictures: Any = None

    def follow(self, outcomes: np.ndarray, begins: np.ndarray) -> None:
        """Add the tips to the traces; those of environments that begin an episode begin with it."""
        tips = outcomes[list(self._core.outcomes.rows.state.tip)].T.tolist()
        for trace, tip, begin in zip(self._traces, tips, begins, strict=True):
            if begin:
                trace.clear()
            trace.append(tuple(tip))
            del trace[:-_TRACE]

    def draw(self, episodes: np.ndarray, outcomes: np.ndarray, steps: np.ndarray) -> tuple[np.ndarray, ...]:
        """The pictures: arrays of shape (height, width, 3), uint8."""
        return tuple(self._one(episodes[:, i], outcomes[:, i], i, int(step)) for i, step in enumerate(steps))

    def _one(self, episode: np.ndarray, outcome: np.ndarray, i: int, step: int) -> np.ndarray:
        core = self._core
        state = core.outcomes.unpack(outcome).state
        shown = (core.episodes.unpack(episode), state, self._traces[i], step)
        if core.engine is None:
            return draw(core.picture(*shown), self._size)
        if self._pictures is None:
            from tensegrity_envs.simulation.mujoco.pictures import Pictures

            self._pictures = Pictures(core.engine.model)
        physics = outcome[list(core.outcomes.rows.state.physics)]
        picture: np.ndarray = self._pictures.rgb(physics, core.spatial_picture(*shown), self._size)
        return picture

    def close(self) -> None:
        """Free what draws dynamic simulations."""
        if self._pictures is not None:
            self._pictures.close()
            self._pictures = None
