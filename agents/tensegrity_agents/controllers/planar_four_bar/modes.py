"""What is elastic in a planar 4-bar mechanism whose actuators are locked, for `fixed_length_damping`."""

from typing import Any

import numpy as np

from tensegrity_agents.controllers.fixed_length_damping import matrices
from tensegrity_envs.core import Core, inverse_softsign
from tensegrity_envs.simulation.skeleton import FourBarSkeleton, side_of_diagonals


class FourBarModes:
    """The angles theta and gamma of the bars DE and CF, in an unloaded rectangle."""

    count = 2

    def __init__(self, core: Core) -> None:
        self.core, self.nominal = core, core.nominal
        self.scale = float(self.nominal.length)

    def read(self, observation: Any, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `Modes`; the branch is the side of CD."""
        vector = np.asarray(observation["observation"], float)
        w = np.arctan2(vector[:, 4:8:2], vector[:, 5:8:2])
        branch = np.asarray(side_of_diagonals(tuple(w.T)))
        away = w - self.rest(lengths, branch)
        return np.arctan2(np.sin(away), np.cos(away)), inverse_softsign(vector[:, -2:]), branch

    def rest(self, lengths: np.ndarray, branch: np.ndarray) -> np.ndarray:
        """See `Modes`."""
        return np.stack(self.nominal.rectangle(tuple(lengths.T), branch)[0], axis=1)

    def place(self, w: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        """See `Modes`."""
        return np.stack(FourBarSkeleton(self.nominal).coordinates(tuple(w.T), tuple(lengths.T)), axis=1)

    def stiffness(self, w: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        """See `Modes`."""
        return matrices(self.nominal.stiffness_matrix(tuple(w.T), tuple(lengths.T)), len(w))
