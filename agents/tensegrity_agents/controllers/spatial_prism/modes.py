"""What is elastic in a spatial prism whose struts are locked, for `fixed_length_damping`."""

import numpy as np

from tensegrity_agents.controllers.fixed_length_damping import matrices
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation


class PrismModes:
    """The orientation of the platform of an unloaded prism."""

    count = 3

    def __init__(self, core: Core) -> None:
        self.core, self.nominal = core, core.nominal
        self.scale = float(self.nominal.design.D)

    def read(self, observed: DecodedObservation, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `Modes`; there is one branch."""
        return observed.rotation, observed.rotation_rates, np.ones(len(observed))

    def rest(self, lengths: np.ndarray, branch: np.ndarray) -> np.ndarray:
        """See `Modes`."""
        return np.zeros((len(lengths), 3))

    def place(self, w: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        """See `Modes`."""
        turned = tuple(np.ascontiguousarray(w.T))
        position = self.nominal.locked_pose(turned, tuple(lengths.T)).position
        return np.stack(np.broadcast_arrays(*position, *turned), axis=1)

    def stiffness(self, w: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        """See `Modes`."""
        return matrices(self.nominal.stiffness_matrix(tuple(self.place(w, lengths).T)), len(w))
