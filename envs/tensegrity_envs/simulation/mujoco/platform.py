"""A rigid platform that is free in space, with the interface of `Linkage`.

"Angles" are MuJoCo's coordinates here: the centroid (x, y, z) [m] and the unit quaternion (w, x, y, z) of the
orientation; their rates the centroid's velocity [m/s] and the angular velocity in the platform's axes [rad/s]. A
configuration is q = (x, y, z, w1, w2, w3) with the rotation vector in world axes [rad]; its velocity has the angular
velocity in world axes in place of the rotation vector's rate.
"""

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_envs.mechanics.spatial_prism.vectors import spin
from tensegrity_envs.simulation.floating_lengths import FloatingPrism

_TINY = 1e-300


def _turned(quaternion: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) from the platform's into world axes."""
    real, part = quaternion[..., :1], quaternion[..., 1:]
    twice = 2 * np.cross(part, vectors)
    return np.asarray(vectors + real * twice + np.cross(part, twice))


class Platform:
    """The platform of a spatial prism.

    Args:
        floating_model: of the prism.

    Raises:
        ValueError: it is a batch of designs.

    Attributes:
        size: numbers in a configuration.
        space: dimensions of positions and forces.
        limit: there is none.
        loops: there are none.
        reference: nodes where the centroid is at the origin and the platform level [m].
        corners: names of the platform's nodes.
        length: of the longest strut [m].
        extent: what is this close to the middle is in the picture [m].
    """

    size, space, limit, loops = 6, 3, np.inf, ()
    joints = ("slide x", "slide y", "slide z", "ball")
    corners = ("P1", "P2", "P3")
    base = ("B1", "B2", "B3")

    def __init__(self, floating_model: FloatingPrism) -> None:
        if any(np.ndim(value) for value in vars(floating_model.design).values()):
            raise ValueError("SpatialPrism: takes one design, not a batch of them")
        self.reference = self.nodes_of(floating_model)
        self.length = 2.4 * float(floating_model.design.D)
        self.extent = 1.4 * float(floating_model.design.D)

    @staticmethod
    def nodes_of(floating_model: FloatingPrism) -> dict[str, np.ndarray]:
        """Nodes where the centroid is at the origin and the platform level [m]."""
        return {name: np.array(place, float) for name, place in floating_model.nodes((0.0,) * 6).items()}

    def fits(self, floating_model: FloatingPrism) -> bool:
        """Whether another prism has the same geometry."""
        return all(
            abs(self.reference[name] - place).max() < 1e-12 * self.length
            for name, place in self.nodes_of(floating_model).items()
        )

    def owner(self, node: str) -> int:
        """0 for the ground, 1 for the platform."""
        return int(node.startswith("P"))

    def local(self, node: str, body: int) -> np.ndarray:
        """Position of a node in the axes of its body [m]."""
        return self.reference[node]

    def joint_angles(self, q: ArrayLike) -> np.ndarray:
        """MuJoCo's coordinates (..., 7) at q of shape (..., 6)."""
        q = np.asarray(q, float)
        angle = np.linalg.norm(q[..., 3:], axis=-1, keepdims=True)
        return np.concatenate([q[..., :3], np.cos(angle / 2), np.sinc(angle / (2 * np.pi)) / 2 * q[..., 3:]], axis=-1)

    def configuration(self, angles: np.ndarray) -> np.ndarray:
        """q (..., 6); rotations are told by at most pi."""
        real, part = angles[..., 3:4], angles[..., 4:]
        sign = np.where(real < 0, -1.0, 1.0)
        size = np.sqrt((part * part).sum(axis=-1, keepdims=True) + _TINY)
        angle = 2 * np.arctan2(size, sign * real)
        return np.concatenate([angles[..., :3], sign * angle / size * part], axis=-1)

    def velocity(self, angles: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Of the configuration (..., 6)."""
        return np.concatenate([rates[..., :3], _turned(angles[..., 3:], rates[..., 3:])], axis=-1)

    def rates_of(self, angles: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """MuJoCo's rates (6,) from a velocity (6,)."""
        back = angles[3:] * np.array([1.0, -1.0, -1.0, -1.0])
        return np.concatenate([velocity[:3], _turned(back, velocity[3:])])

    def rates_by_configuration(self, angles: np.ndarray) -> np.ndarray:
        """MuJoCo's rates by the rates of q, rotation vector included, shape (6, 6)."""
        turn: np.ndarray = np.array(spin(tuple(self.configuration(angles)[3:].tolist())))
        columns = [np.concatenate([row, np.zeros(3)]) for row in np.eye(3)]
        columns += [np.concatenate([np.zeros(3), column]) for column in turn.T]
        return np.stack([self.rates_of(angles, column) for column in columns], axis=1)

    def configuration_by_rates(self, angles: np.ndarray) -> np.ndarray:
        """The rates of q, rotation vector included, by MuJoCo's, shape (6, 6)."""
        return np.linalg.inv(self.rates_by_configuration(angles))

    def positions(self, angles: np.ndarray) -> dict[str, np.ndarray]:
        """Positions (..., 3) of the nodes [m]."""
        angles = np.asarray(angles, float)
        shape = (*angles.shape[:-1], 3)
        found = {}
        for name, place in self.reference.items():
            here = np.broadcast_to(place, shape)
            found[name] = angles[..., :3] + _turned(angles[..., 3:], here) if self.owner(name) else here
        return found

    def loop_error(self, angles: np.ndarray) -> np.ndarray:
        """Nothing: there are no loops."""
        return np.zeros(np.asarray(angles).shape[:-1])

    assembly_error = loop_error
