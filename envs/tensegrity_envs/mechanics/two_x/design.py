"""Parameters of the 2-X manipulator, and the published designs."""

import math
from dataclasses import dataclass

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.design import require, require_finite_numbers


@dataclass(frozen=True)
class TwoXDesign:
    """Parameters of a 2-X manipulator. A field may be an array of shape (n,): a batch of designs.

    Attributes:
        b: length of base and top bars [m].
        l: length of the crossed bars [m], l > b.
        a: length of the offset after each joint [m], 0 for none.
        k1: stiffness of *each* of joint 1's two springs (zero free length) [N/m].
        k2: the same for joint 2 [N/m].
        min_tension: lower bound of every cable tension [N].
        max_tension: upper bound of every cable tension [N].
        payload: point mass at the tip [kg].
        bar_density: density of the bars [kg/m3].
        bar_radius: radius of the bars, solid cylinders [m].
        gravity: gravitational acceleration, towards -y [m/s2].
        joint_limit: |alpha_i| is at most this [rad]; pi excludes the flat poses, 2 pi is the full torus.
    """

    b: Component
    l: Component
    a: Component
    k1: Component
    k2: Component
    min_tension: Component
    max_tension: Component
    payload: Component = 0.0
    bar_density: Component = 2700.0
    bar_radius: Component = 0.005
    gravity: Component = 9.8
    joint_limit: float = math.pi

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            TypeError: a field is not a number.
            ValueError: a field is outside its range; the message names field and value.
        """
        require_finite_numbers(self)
        name = type(self).__name__
        require(self.b > 0, name, "b", self.b, "positive")
        require(
            self.l > self.b, name, "l", self.l, f"greater than b = {self.b!r} (else the X-joints cannot be assembled)"
        )
        for field in ("a", "k1", "k2", "min_tension", "payload", "bar_density", "gravity"):
            require(getattr(self, field) >= 0, name, field, getattr(self, field), "zero or positive")
        require(self.bar_radius > 0, name, "bar_radius", self.bar_radius, "positive")
        require(
            self.max_tension > self.min_tension,
            name,
            "max_tension",
            self.max_tension,
            f"greater than min_tension = {self.min_tension!r}",
        )
        if np.ndim(self.joint_limit):
            raise TypeError(f"{name}.joint_limit = {self.joint_limit!r}: must be one number for the whole batch")
        require(0 < self.joint_limit <= 2 * math.pi, name, "joint_limit", self.joint_limit, "in (0, 2 pi]")


# [Muralidharan2022, section 5]. The paper prints neither density nor gravity; aluminium at 2700 kg/m3 and 9.8 m/s2
# reproduce the one number that it prints, to all its digits.
MURALIDHARAN2022 = TwoXDesign(b=0.05, l=0.10, a=0.20, k1=600.0, k2=300.0, min_tension=5.0, max_tension=155.0)


def FURET2018(b: float, joint_limit: float = 2 * math.pi) -> TwoXDesign:
    """The plain 2-X of [Furet2018]: L = 1 m, no offsets, purely kinematic (no springs, no masses), on the full torus.

    Args:
        b: length of base and top bars [m], below 1; the paper's examples are 2/5, 1/2, 2/3 and 9/10.
        joint_limit: |alpha| <= joint_limit [rad]; figure 7 of the paper has 2 pi / 3.
    """
    return TwoXDesign(
        b=b, l=1.0, a=0.0, k1=0.0, k2=0.0, min_tension=0.0, max_tension=1.0, bar_density=0.0, joint_limit=joint_limit
    )
