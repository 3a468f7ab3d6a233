"""What is elastic in a planar 4-bar mechanism whose actuators are locked, for `fixed_length_damping`."""

import numpy as np

from tensegrity_agents.controllers.fixed_length_damping import matrices
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation.floating_lengths import FloatingFourBar, side_of_diagonals


class FourBarModes:
    """The angles theta and gamma of the bars DE and CF, in an unloaded rectangle."""

    count = 2

    def __init__(self, core: Core) -> None:
        self.core, self.nominal = core, core.nominal
        self.scale = float(self.nominal.length)

    def read(self, observed: DecodedObservation, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `Modes`; the branch is the side of CD."""
        w = observed.joint_angles
        branch = np.asarray(side_of_diagonals(tuple(w.T)))
        elastic = w - self.rest(lengths, branch)
        return np.arctan2(np.sin(elastic), np.cos(elastic)), observed.joint_rates[:, 2:], branch

    def rest(self, lengths: np.ndarray, branch: np.ndarray) -> np.ndarray:
        """See `Modes`."""
        return np.stack(self.nominal.rectangle(tuple(lengths.T), branch)[0], axis=1)

    def place(self, w: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        """See `Modes`."""
        return np.stack(FloatingFourBar(self.nominal).coordinates(tuple(w.T), tuple(lengths.T)), axis=1)

    def stiffness(self, w: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        """See `Modes`."""
        return matrices(self.nominal.stiffness_matrix(tuple(w.T), tuple(lengths.T)), len(w))
