"""What an analytic controller reads off the observation of a dual-triangle arm."""

from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.core import Core


class Reading(NamedTuple):
    """A batch of n observations in SI units.

    Attributes:
        tip: shape (n, 2) [m].
        target: shape (n, 2) [m].
        inputs: shape (n, 3) control inputs or (n, 6) free lengths [m].
        configuration: shape (n, 3) [rad], or None where joint angles are not observed.
    """

    tip: np.ndarray
    target: np.ndarray
    inputs: np.ndarray
    configuration: np.ndarray | None

    def take(self, index: np.ndarray) -> "Reading":
        """Those of some environments."""
        return Reading(*(None if value is None else value[index] for value in self))  # type: ignore[arg-type]


def read(observation: Any, core: Core) -> Reading:
    """Undo the normalization that `_DualTriangle.observation` documents.

    Args:
        observation: Dict of arrays of shape (n, ...).
        core: of the environment.
    """
    vector = np.asarray(observation["observation"], float)
    simulation: Any = core.simulation
    size, joints = simulation.action_size, core.nominal.segments
    low, high = simulation.bounds(core.nominal)
    configuration = None
    if core.observe_all:  # type: ignore[attr-defined]
        angles = vector[:, 2 + size : 2 + size + 2 * joints]
        configuration = np.arctan2(angles[:, 0::2], angles[:, 1::2])
    return Reading(
        np.asarray(observation["achieved_goal"], float),
        np.asarray(observation["desired_goal"], float),
        (vector[:, 2 : 2 + size] * (high - low) + high + low) / 2,
        configuration,
    )
