"""Parameters of the planar 4-bar mechanism, validated, and the published ones."""

import math
from dataclasses import dataclass

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.design import require, require_finite_numbers


@dataclass(frozen=True)
class PlanarFourBarDesign:
    """Parameters of a planar 4-bar class-2 tensegrity. A number may be an array of shape (n,): a batch of designs.

    Attributes:
        length: L, of the bars AD, BC, DE and CF, and the distance of the base joints A and B [m].
        stiffness: K, of the three springs CE, EF and DF, whose free length is zero [N/m].
    """

    length: Component
    stiffness: Component

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            TypeError: a field is not a number.
            ValueError: a field is not finite and positive; the message names field and value.
        """
        require_finite_numbers(self)
        for field in ("length", "stiffness"):
            value = getattr(self, field)
            require(value > 0, type(self).__name__, field, value, "positive")

    @property
    def joint_limit(self) -> float:
        """|theta| and |gamma| are at most this [rad]: no stop, they are told in (-pi, pi]."""
        return math.pi

    @property
    def is_batch(self) -> bool:
        """Whether a field is an array."""
        return any(isinstance(value, np.ndarray) for value in vars(self).values())


JI2014 = PlanarFourBarDesign(length=10.0, stiffness=100.0)
