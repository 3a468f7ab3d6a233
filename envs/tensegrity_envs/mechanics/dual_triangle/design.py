"""Parameters of an arm of dual-triangles, validated, and the published ones."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tensegrity_envs.compiler.namespace import Component, namespace_of
from tensegrity_envs.mechanics.design import require, require_finite_numbers


@dataclass(frozen=True)
class DualTriangleDesign:
    """Parameters of a dual-triangle segment. A number may be an array of shape (n,): a batch of designs.

    Two triangles share the pivot: the base triangle has its corners A, B at (-b1, +-a1) from it, the moving one D, C at
    (b2, +-a2) in its own axes. Spring 1 joins A and D (on the +y side, it shortens for q > 0), spring 2 joins B and C.

    Attributes:
        a1: half the width of the base triangle [m].
        b1: height of the base triangle: distance from its side A-B to the pivot [m].
        a2: half the width of the moving triangle [m].
        b2: height of the moving triangle [m].
        k1: stiffness of spring 1 [N/m].
        k2: stiffness of spring 2 [N/m].
        free_length1: nominal free length of spring 1 [m], L0 of a symmetric segment.
        free_length2: nominal free length of spring 2 [m].
        springs: "bilateral" (they pull and push, as [Zhao2021, Eq. 1] assumes) or "cable" (they only pull).
        max_joint_angle: |q| is at most this [rad]; None for the angle at which the triangles' edges meet.
    """

    a1: Component
    b1: Component
    a2: Component
    b2: Component
    k1: Component
    k2: Component
    free_length1: Component
    free_length2: Component
    springs: Literal["bilateral", "cable"] = "bilateral"
    max_joint_angle: Component = None

    @classmethod
    def symmetric(
        cls,
        a: Component,
        b: Component,
        k: Component,
        free_length: Component,
        springs: Literal["bilateral", "cable"] = "bilateral",
        max_joint_angle: Component = None,
    ) -> "DualTriangleDesign":
        """Two equal triangles of half width a and height b [m], two equal springs (k [N/m], free length L0 [m])."""
        return cls(a, b, a, b, k, k, free_length, free_length, springs, max_joint_angle)

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            TypeError: a field is not a number.
            ValueError: a field is outside its range; the message names field and value.
        """
        name = type(self).__name__
        besides = {"springs"} if self.max_joint_angle is not None else {"springs", "max_joint_angle"}
        require_finite_numbers(self, besides)
        for field in ("a1", "b1", "a2", "b2", "k1", "k2"):
            require(getattr(self, field) > 0, name, field, getattr(self, field), "positive")
        for field in ("free_length1", "free_length2"):
            require(getattr(self, field) >= 0, name, field, getattr(self, field), "zero or positive")
        if self.springs not in ("bilateral", "cable"):
            raise ValueError(f'{name}.springs = {self.springs!r}: must be "bilateral" or "cable"')
        if self.max_joint_angle is not None:
            stop = self.stop_angle
            what = f"in (0, {stop!r}]: the triangles' edges meet there"
            inside = (self.max_joint_angle > 0) & (self.max_joint_angle <= stop)
            require(inside, name, "max_joint_angle", self.max_joint_angle, what)

    @property
    def beta12(self) -> Component:
        """The angle atan(a1/b1) + atan(a2/b2) [rad]; printed with tan instead of atan in [Zhao2021, section II]."""
        xp = namespace_of(self.a1, self.b1, self.a2, self.b2)
        return xp.atan2(self.a1, self.b1) + xp.atan2(self.a2, self.b2)

    @property
    def stop_angle(self) -> Component:
        """The angle pi - beta12 [rad] at which an edge of the moving triangle meets one of the base triangle."""
        # = atan(b1/a1) + atan(b2/a2), without the cancellation of flat triangles
        xp = namespace_of(self.a1, self.b1, self.a2, self.b2)
        return xp.atan2(self.b1, self.a1) + xp.atan2(self.b2, self.a2)

    @property
    def joint_limit(self) -> Component:
        """|q| is at most this [rad]: `max_joint_angle` where it is given, else `stop_angle`."""
        return self.stop_angle if self.max_joint_angle is None else self.max_joint_angle

    @property
    def is_symmetric(self) -> bool:
        """Whether both triangles and both springs (with their nominal free lengths) are equal."""
        pairs = (
            (self.a1, self.a2),
            (self.b1, self.b2),
            (self.k1, self.k2),
            (self.free_length1, self.free_length2),
        )
        return all(bool(np.all(first == second)) for first, second in pairs)

    @property
    def is_batch(self) -> bool:
        """Whether a field is an array."""
        return any(isinstance(value, np.ndarray) for value in vars(self).values())


def _published(width: float, free_length: float) -> DualTriangleDesign:
    b = 0.05  # the paper prints ratios only
    return DualTriangleDesign.symmetric(a=width * b, b=b, k=500.0, free_length=free_length * b)


# [Zhao2021] gives two contradictory parameter sets for its figure 6: a/b = 1.1, L0/b = 0.7 in the text, 1 and 1 in the
# caption. Only ratios are printed; size and stiffness are ours.
ZHAO2021_TEXT = _published(1.1, 0.7)
ZHAO2021_CAPTION = _published(1.0, 1.0)
