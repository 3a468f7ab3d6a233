"""What an analytic controller reads off the observation of a spatial prism."""

from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.core import Core


class Reading(NamedTuple):
    """A batch of n observations in SI units.

    Attributes:
        tip: centroid of the platform, shape (n, 3) [m].
        lengths: of the struts, shape (n, 3) [m].
        next_goal: where the goal will be after this step, shape (n, 3) [m].
    """

    tip: np.ndarray
    lengths: np.ndarray
    next_goal: np.ndarray


def read(observation: Any, core: Core) -> Reading:
    """Undo the normalization that `SpatialPrismTrack.observation` documents.

    Args:
        observation: Dict of arrays of shape (n, ...).
        core: of the environment.
    """
    vector = np.asarray(observation["observation"], float)
    simulation: Any = core.simulation
    low, high = simulation.bounds(core.nominal)
    tip = np.asarray(observation["achieved_goal"], float)
    ahead = vector[:, 6:9]
    return Reading(
        tip,
        (vector[:, 3:6] * (high - low) + high + low) / 2,
        tip + simulation.rate * ahead / np.maximum(1 - np.abs(ahead), 1e-12),
    )
