"""Parameters of a spatial prism, validated, and the published ones."""

from dataclasses import dataclass

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.design import require, require_finite_numbers


@dataclass(frozen=True)
class SpatialPrismDesign:
    """Parameters of a spatial prism. A number may be an array of shape (n,): a batch of designs.

    Attributes:
        d: circumradius of the platform's triangle [m].
        D: circumradius of the base's triangle [m].
        k: stiffness of every spring [N/m]; their free lengths are zero.
    """

    d: Component
    D: Component
    k: Component

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            TypeError: a field is not a number.
            ValueError: a field is not positive or not finite; the message names field and value.
        """
        require_finite_numbers(self)
        for field in ("d", "D", "k"):
            require(getattr(self, field) > 0, type(self).__name__, field, getattr(self, field), "positive")


JAHROMY = SpatialPrismDesign(d=0.2, D=0.5, k=100.0)  # [Jahromy, section 4]
