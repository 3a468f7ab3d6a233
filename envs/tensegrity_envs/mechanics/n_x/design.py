"""Parameters of an n-X manipulator."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.design import check_design, require, require_finite_numbers
from tensegrity_envs.mechanics.n_x.routing import PER_JOINT, checked_routing
from tensegrity_envs.mechanics.two_x import MURALIDHARAN2022, TwoXDesign

_PER_JOINT_FIELDS = ("b", "l", "a", "k_left", "k_right")
_COMMON_FIELDS = ("min_tension", "max_tension", "payload", "bar_density", "bar_radius", "gravity", "joint_limit")


@dataclass(frozen=True)
class NXDesign:
    """Parameters of a chain of X-joints, from the base on.

    Where a field is said to be "of each joint" it is one number for all joints or a tuple of as many numbers as there
    are joints. A number may be an array of shape (n,) instead: a batch of designs.

    Attributes:
        joints: how many X-joints there are.
        b: length of base and top bar of each joint [m].
        l: length of the crossed bars of each joint [m], l > b.
        a: length of the offset after each joint [m], 0 for none.
        k_left: stiffness of the spring on the left side of each joint (zero free length) [N/m].
        min_tension: lower bound of every cable tension [N].
        max_tension: upper bound of every cable tension [N].
        k_right: as k_left, of the spring on the right side; None for the same as k_left.
        payload: point mass at the tip [kg].
        bar_density: density of the bars [kg/m3].
        bar_radius: radius of the bars, solid cylinders [m].
        gravity: gravitational acceleration, towards -y [m/s2].
        joint_limit: |alpha_i| is at most this [rad]; pi excludes the flat poses, 2 pi is the full torus.
        routing: "per_joint" (two cables for each joint, along its sides), "from_base" (each of these cables spans the
            joints below its own, too), or a matrix with a row for each cable and a column for each joint: -1 where the
            cable spans the joint's left side, 1 its right side, 0 neither.
    """

    joints: int
    b: Component
    l: Component
    a: Component
    k_left: Component
    min_tension: Component
    max_tension: Component
    k_right: Component = None
    payload: Component = 0.0
    bar_density: Component = 2700.0
    bar_radius: Component = 0.005
    gravity: Component = 9.8
    joint_limit: float = math.pi
    routing: str | Sequence[Sequence[int]] = PER_JOINT

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            TypeError: a field is not a number, nor a tuple of them where that is allowed.
            ValueError: a field is outside its range or of the wrong length; the message names field and value.
        """
        name = type(self).__name__
        if isinstance(self.joints, bool) or not isinstance(self.joints, int | np.integer):
            raise TypeError(f"{name}.joints = {self.joints!r}: must be an integer")
        object.__setattr__(self, "joints", int(self.joints))
        require(self.joints >= 1, name, "joints", self.joints, "1 or more")
        for field in _PER_JOINT_FIELDS:
            given = getattr(self, field)
            if isinstance(given, list | tuple):
                object.__setattr__(self, field, tuple(given))
                require(len(given) == self.joints, name, field, given, f"one number or {self.joints} of them")
        given = ("joints", "routing") if self.k_right is not None else ("joints", "routing", "k_right")
        require_finite_numbers(self, given, _PER_JOINT_FIELDS)
        for i, (b, l) in enumerate(zip(self.each("b"), self.each("l"), strict=True)):
            require(b > 0, name, "b", self.b, "positive")
            what = f"greater than b = {b!r} (else X-joint {i + 1} cannot be assembled)"
            require(l > b, name, "l", self.l, what)
        for field in ("a", "k_left", "k_right"):
            require(all(np.all(value >= 0) for value in self.each(field)), name, field, getattr(self, field), _NO_LESS)
        for field in ("min_tension", "payload", "bar_density", "gravity"):
            require(getattr(self, field) >= 0, name, field, getattr(self, field), _NO_LESS)
        require(self.bar_radius > 0, name, "bar_radius", self.bar_radius, "positive")
        above = f"greater than min_tension = {self.min_tension!r}"
        require(self.max_tension > self.min_tension, name, "max_tension", self.max_tension, above)
        if np.ndim(self.joint_limit):
            raise TypeError(f"{name}.joint_limit = {self.joint_limit!r}: must be one number for the whole batch")
        require(0 < self.joint_limit <= 2 * math.pi, name, "joint_limit", self.joint_limit, "in (0, 2 pi]")
        object.__setattr__(self, "routing", checked_routing(self.routing, self.joints, name))

    def each(self, field: str) -> Components:
        """The values of a field for the joints, from the base on."""
        value = getattr(self, field)
        if value is None:  # k_right
            return self.each("k_left")
        return value if isinstance(value, tuple) else (value,) * self.joints

    @classmethod
    def from_two_x(cls, design: TwoXDesign, joints: int = 2) -> "NXDesign":
        """The chain of joints as a `TwoXDesign` has them.

        Of two joints it is the same arm; further joints have the springs of the second one.

        Raises:
            TypeError: it is no such design, or the number of joints is no integer.
            ValueError: there is no joint.
        """
        check_design(design, TwoXDesign, "MURALIDHARAN2022")
        if isinstance(joints, bool) or not isinstance(joints, int | np.integer):
            raise TypeError(f"joints = {joints!r}: must be an integer")
        k = (design.k1, *((design.k2,) * (joints - 1)))
        common = {field: getattr(design, field) for field in _COMMON_FIELDS}
        return cls(joints, design.b, design.l, design.a, k, **common)


_NO_LESS = "zero or positive"

# Three joints with the bars of the 2-X's paper, and stronger springs and cables to carry one joint more.
THREE_X = replace(NXDesign.from_two_x(MURALIDHARAN2022, 3), k_left=(900.0, 600.0, 300.0), max_tension=250.0)
