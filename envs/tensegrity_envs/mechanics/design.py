"""What every design shares: validation that names the field, batches of designs, and the members of a structure."""

import dataclasses
import operator
from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args

import numpy as np

from tensegrity_envs.compiler.namespace import Component

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

D = TypeVar("D")
Index = int | slice | np.ndarray  # of a batch: which of its designs


def require(condition: Component, design: str, field: str, value: object, what: str) -> None:
    """Raise ValueError naming design, field and value unless the condition holds (for arrays: everywhere)."""
    if not np.all(condition):
        raise ValueError(f"{design}.{field} = {value!r}: must be {what}")


def check_design(given: object, kind: type, example: str) -> None:
    """Raise TypeError unless a design is of its kind; `example` is one that there is in `tensegrity_envs.mechanics`."""
    if not isinstance(given, kind):
        raise TypeError(f"design = {given!r}: must be a {kind.__name__}, such as tensegrity_envs.mechanics.{example}")


def check_one_design(design: object, what: str) -> None:
    """Raise ValueError for a batch of designs: where a field, or a number of a tuple, is an array."""
    parts = [part for value in vars(design).values() for part in (value if isinstance(value, tuple) else (value,))]
    if any(isinstance(part, np.ndarray) for part in parts):
        raise ValueError(f"{what} takes one design, not a batch of them; take(index) picks one")


def require_finite_numbers(
    design: "DataclassInstance", besides: Collection[str] = (), tuples: Collection[str] = ()
) -> None:
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


def take(batch: D, index: Index) -> D:
    """Those at `index` of a batch of designs, or of the mechanisms that such a batch makes; itself if it is no batch.

    Arrays of shape (n,) are indexed, also in its tuples and lists, and in designs and mechanisms that it has; all else
    is shared.
    """
    own = vars(batch)
    taken = {name: part for name, value in own.items() if (part := _taken(value, index)) is not value}
    if not taken:
        return batch
    part = object.__new__(type(batch))  # no validation: part of a valid batch is valid, and this is a hot path
    part.__dict__.update(own | taken)
    return part


def _taken(value: object, index: Index) -> Any:
    if value is None or isinstance(value, float | int | str):  # which most are: this saves them a long way
        return value
    if isinstance(value, np.ndarray):
        return value[index]
    if isinstance(value, tuple | list):
        parts = [_taken(part, index) for part in value]
        return value if all(map(operator.is_, parts, value)) else type(value)(parts)
    return take(value, index) if dataclasses.is_dataclass(value) or hasattr(value, "design") else value


Kind = Literal["bar", "strut", "spring", "cable", "actuator", "torsional spring"]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class Member:
    """A straight member between two named nodes, or a torsional spring between two directions from a pivot.

    Attributes:
        name: unique within the mechanism.
        kind: "bar" (rigid), "strut" (rigid, and meant to be compressed only), "spring" (zero or given free length),
            "cable" (a tension input, or an edge that keeps its length), "actuator" (prismatic: rigid, its length is an
            input) or "torsional spring" (in a plane).
        nodes: the names of its two end nodes; of a cable, of the first span; of a torsional spring, of the nodes whose
            directions from the pivot it joins.
        stiffness: [N/m], of a spring; [N m/rad], of a torsional spring.
        free_length: [m], of a spring.
        is_input: of a spring: its free length is an input, the next one in the mechanism's order.
        goes_slack: of a spring: it pulls only (a sprung cable), without force below its free length.
        mass: [kg], of a bar or a strut, uniform along its length.
        radius: [m], of a bar or a strut.
        more_spans: of a cable that spans several gaps, with constant lengths between them: the end nodes of the others.
        keeps_length: of a cable: it is an edge of a rigid body, and takes no input.
        pivot: of a torsional spring: the node about which it turns.
        free_angle: of a torsional spring: [rad], from the first node to the second one, counter-clockwise.
    """

    name: str
    kind: Kind
    nodes: tuple[str, str]
    stiffness: float = 0.0
    free_length: float = 0.0
    is_input: bool = False
    goes_slack: bool = False
    mass: float = 0.0
    radius: float = 0.0
    more_spans: tuple[tuple[str, str], ...] = ()
    keeps_length: bool = False
    pivot: str | None = None
    free_angle: float = 0.0

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: there is no such kind, or a torsional spring has no pivot, or another member has one.
        """
        if self.kind not in KINDS:
            raise ValueError(f"{self.name}: kind = {self.kind!r}: must be one of {', '.join(map(repr, KINDS))}")
        if (self.kind == "torsional spring") != (self.pivot is not None):
            raise ValueError(f"{self.name}: pivot = {self.pivot!r}: the name of a node, of a torsional spring alone")

    @property
    def spans(self) -> tuple[tuple[str, str], ...]:
        """The pairs of nodes between which it lies; its length is the sum of their distances."""
        return (self.nodes, *self.more_spans)

    @property
    def is_rigid(self) -> bool:
        """Whether it is a bar or a strut."""
        return self.kind in ("bar", "strut")

    @property
    def takes_input(self) -> bool:
        """Whether its tension, its length or its free length is an input, the next one in the mechanism's order."""
        return self.is_input or (self.kind in ("cable", "actuator") and not self.keeps_length)
