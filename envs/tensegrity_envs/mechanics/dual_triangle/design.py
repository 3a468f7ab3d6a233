"""Parameters of an arm of dual-triangles, validated, and the published ones."""

from dataclasses import dataclass, replace
from functools import reduce
from typing import Literal

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.mechanics.design import require, require_finite_numbers

_PER_SEGMENT = ("a1", "b1", "a2", "b2", "k1", "k2", "free_length1", "free_length2")


@dataclass(frozen=True)
class DualTriangleDesign:
    """Parameters of the segments of an arm. A number may be an array of shape (n,): a batch of designs.

    Each field but `springs` and `max_joint_angle` is one number for all segments, or a tuple of as many numbers as the
    arm has segments, from the base on.

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
        max_joint_angle: every |q_i| is at most this [rad]; None for the angle at which the triangles' edges meet, the
            smallest one of unequal segments.
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
            TypeError: a field is not a number, nor a tuple of them where that is allowed.
            ValueError: a field is outside its range or of the wrong length; the message names field and value.
        """
        name = type(self).__name__
        besides = {"springs"} if self.max_joint_angle is not None else {"springs", "max_joint_angle"}
        for field in _PER_SEGMENT:
            if isinstance(getattr(self, field), list | tuple):
                object.__setattr__(self, field, tuple(getattr(self, field)))
        require_finite_numbers(self, besides, _PER_SEGMENT)
        self._check_lengths(name)
        count = self.segments or 1
        for field in ("a1", "b1", "a2", "b2", "k1", "k2"):
            positive = all(np.all(value > 0) for value in self.each(field, count))
            require(positive, name, field, getattr(self, field), "positive")
        for field in ("free_length1", "free_length2"):
            allowed = all(np.all(value >= 0) for value in self.each(field, count))
            require(allowed, name, field, getattr(self, field), "zero or positive")
        if self.springs not in ("bilateral", "cable"):
            raise ValueError(f'{name}.springs = {self.springs!r}: must be "bilateral" or "cable"')
        if self.max_joint_angle is not None:
            stop = self.stop_angle
            what = f"in (0, {stop!r}]: the triangles' edges meet there"
            inside = (self.max_joint_angle > 0) & (self.max_joint_angle <= stop)
            require(inside, name, "max_joint_angle", self.max_joint_angle, what)

    def _check_lengths(self, name: str) -> None:
        """Refuse tuples of different lengths.

        Raises:
            ValueError: there are two lengths, or a tuple is empty.
        """
        given = [(field, getattr(self, field)) for field in _PER_SEGMENT if isinstance(getattr(self, field), tuple)]
        for field, value in given:
            first, known = given[0]
            what = f"one number or as many as {first} has, {len(known)}" if known else "one number or more"
            require(len(value) == len(known) > 0, name, field, value, what)

    @property
    def segments(self) -> int | None:
        """The number of segments that the fields are for; None where each is one number for all segments."""
        values = (getattr(self, field) for field in _PER_SEGMENT)
        return next((len(value) for value in values if isinstance(value, tuple)), None)

    def each(self, field: str, segments: int) -> Components:
        """The values of a field for the segments, from the base on."""
        value = getattr(self, field)
        return value if isinstance(value, tuple) else (value,) * segments

    def of_segments(self, segments: int) -> "tuple[DualTriangleDesign, ...]":
        """The designs of the segments, each of one number for every field, with the joint limit of the whole arm.

        Raises:
            ValueError: the fields are for another number of segments.
        """
        if self.segments is None:
            return (self,) * segments
        if self.segments != segments:
            raise ValueError(
                f"{type(self).__name__}: its fields are for {self.segments} segments, not for {segments}: give "
                f"segments={self.segments}, or one number or {segments} of them for each field"
            )
        common = {"springs": self.springs, "max_joint_angle": self.joint_limit}
        designs = []
        for row in zip(*(self.each(field, segments) for field in _PER_SEGMENT), strict=True):
            one = object.__new__(type(self))  # no validation: part of a valid design is valid, symbols or not
            one.__dict__.update(zip(_PER_SEGMENT, row, strict=True), **common)
            designs.append(one)
        return tuple(designs)

    def stiffened(self, factor: Component) -> "DualTriangleDesign":
        """With springs that are `factor` times as stiff, a number or an array of shape (n,)."""

        def times(value: Component) -> Component:
            return tuple(k * factor for k in value) if isinstance(value, tuple) else value * factor

        return replace(self, k1=times(self.k1), k2=times(self.k2))

    @property
    def nominal_length(self) -> Component:
        """`free_length1` [m], the smallest one of unequal segments."""
        return min(self.free_length1) if isinstance(self.free_length1, tuple) else self.free_length1

    @property
    def shortest_length(self) -> Component:
        """The smallest nominal free length of any spring [m]."""
        count = self.segments or 1
        return min((*self.each("free_length1", count), *self.each("free_length2", count)))

    @property
    def beta12(self) -> Component:
        """The angle atan(a1/b1) + atan(a2/b2) [rad] of a segment; printed with tan in [Zhao2021, section II]."""
        xp = namespace_of(self.a1, self.b1, self.a2, self.b2)
        return xp.atan2(self.a1, self.b1) + xp.atan2(self.a2, self.b2)

    @property
    def stop_angle(self) -> Component:
        """The angle pi - beta12 [rad] at which an edge of the moving triangle meets one of the base triangle; the
        smallest one of unequal segments.
        """
        rows = zip(*(self.each(field, self.segments or 1) for field in ("a1", "b1", "a2", "b2")), strict=True)
        stops = []
        for a1, b1, a2, b2 in rows:
            # = atan(b1/a1) + atan(b2/a2), without the cancellation of flat triangles
            xp = namespace_of(a1, b1, a2, b2)
            stops.append(xp.atan2(b1, a1) + xp.atan2(b2, a2))
        return stops[0] if len(stops) == 1 else reduce(namespace_of(*stops).minimum, stops)

    @property
    def joint_limit(self) -> Component:
        """Every |q_i| is at most this [rad]: `max_joint_angle` where it is given, else `stop_angle`."""
        return self.stop_angle if self.max_joint_angle is None else self.max_joint_angle

    @property
    def is_symmetric(self) -> bool:
        """Whether both triangles and both springs (with their nominal free lengths) of each segment are equal."""
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
        count = self.segments or 1
        values = [value for field in _PER_SEGMENT for value in self.each(field, count)]
        return any(isinstance(value, np.ndarray) for value in (*values, self.max_joint_angle))


def _published(width: float, free_length: float) -> DualTriangleDesign:
    b = 0.05  # the paper prints ratios only
    return DualTriangleDesign.symmetric(a=width * b, b=b, k=500.0, free_length=free_length * b)


# [Zhao2021] gives two contradictory parameter sets for its figure 6: a/b = 1.1, L0/b = 0.7 in the text, 1 and 1 in the
# caption. Only ratios are printed; size and stiffness are ours.
ZHAO2021_TEXT = _published(1.1, 0.7)
ZHAO2021_CAPTION = _published(1.0, 1.0)
