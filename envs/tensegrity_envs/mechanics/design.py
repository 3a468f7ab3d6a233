"""What every design shares: validation that names the field, batches of designs, and the members of a structure."""

import dataclasses
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np

D = TypeVar("D")


def require(condition: Any, design: str, field: str, value: Any, what: str) -> None:
    """Raise ValueError naming design, field and value unless the condition holds (for arrays: everywhere)."""
    if not np.all(condition):
        raise ValueError(f"{design}.{field} = {value!r}: must be {what}")


def require_finite_numbers(design: Any, besides: Collection[str] = (), tuples: Collection[str] = ()) -> None:
    """Raise unless every field of a design is a finite real number, or an array of them, all arrays of one shape.

    Args:
        design: the dataclass instance.
        besides: names of the fields that hold something else.
        tuples: names of the fields that may hold a tuple of such numbers.

    Raises:
        TypeError: a field is not a number.
        ValueError: a field is NaN or infinite, or the shapes of two arrays differ.
    """
    name = type(design).__name__
    first: tuple[str, tuple[int, ...]] | None = None
    for field in dataclasses.fields(design):
        if field.name in besides:
            continue
        given = getattr(design, field.name)
        for value in given if isinstance(given, tuple) and field.name in tuples else (given,):
            kind = np.asarray(value).dtype.kind if isinstance(value, (int, float, np.generic, np.ndarray)) else ""
            if isinstance(value, bool) or kind not in ("i", "u", "f"):
                raise TypeError(
                    f"{name}.{field.name} = {given!r}: must be a number or an array of numbers, in SI units"
                )
            require(np.isfinite(value), name, field.name, given, "finite")
            if isinstance(value, np.ndarray):
                first = first or (field.name, value.shape)
                what = f"of shape {first[1]}, as {first[0]} is: a batch of designs has one length"
                require(value.shape == first[1], name, field.name, given, what)


def take(design: D, index: Any) -> D:
    """The designs at `index` of a batch of designs: array fields are indexed, floats are shared."""
    arrays = {}
    for field in dataclasses.fields(design):  # type: ignore[arg-type]
        value = getattr(design, field.name)
        if isinstance(value, np.ndarray):
            arrays[field.name] = value[index]
        elif isinstance(value, tuple) and any(isinstance(part, np.ndarray) for part in value):
            arrays[field.name] = tuple(part[index] if isinstance(part, np.ndarray) else part for part in value)
    if not arrays:
        return design
    part = object.__new__(type(design))  # no validation: part of a valid batch is valid, and this is a hot path
    part.__dict__.update(vars(design) | arrays)
    return part


@dataclass(frozen=True)
class Member:
    """A straight member between two named nodes.

    Attributes:
        name: unique within the mechanism.
        kind: "bar" (rigid), "spring" (zero or given free length), "cable" (a tension input) or "actuator" (a rigid bar
            whose length is an input).
        nodes: the names of its two end nodes; of a cable, of the first span.
        stiffness: [N/m], of a spring.
        free_length: [m], of a spring.
        is_input: of a spring: its free length is an input, the next one in the mechanism's order.
        goes_slack: of a spring: it pulls only (a sprung cable), without force below its free length.
        mass: [kg], of a bar, uniform along its length.
        radius: [m], of a bar.
        more_spans: of a cable that spans several gaps, with constant lengths between them: the end nodes of the others.
    """

    name: str
    kind: Literal["bar", "spring", "cable", "actuator"]
    nodes: tuple[str, str]
    stiffness: float = 0.0
    free_length: float = 0.0
    is_input: bool = False
    goes_slack: bool = False
    mass: float = 0.0
    radius: float = 0.0
    more_spans: tuple[tuple[str, str], ...] = ()

    @property
    def spans(self) -> tuple[tuple[str, str], ...]:
        """The pairs of nodes between which it lies; its length is the sum of their distances."""
        return (self.nodes, *self.more_spans)
