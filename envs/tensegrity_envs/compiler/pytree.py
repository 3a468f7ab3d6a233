"""Pytrees: nested components (in tuples, named tuples, dicts, designs) as matrices of numbers, and back.

A batch of n environments is stored as one matrix: a row for each component, a column for each environment. Compiled
functions run along the columns; replacing an episode is copying a column.
"""

import dataclasses
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any, Generic, TypeVar

import numpy as np

T = TypeVar("T")

_CROWDED, _FEW, _GAP = 128, 4, 8  # columns, rows, columns


def tree_leaves(tree: object, is_leaf: Callable[[Any], bool]) -> Iterator[Any]:
    """The leaves of a pytree, in a fixed order; whatever is neither a container nor a leaf is left out."""
    if is_leaf(tree):
        yield tree
    elif isinstance(tree, tuple | list):
        for part in tree:
            yield from tree_leaves(part, is_leaf)
    elif isinstance(tree, dict):
        for part in tree.values():
            yield from tree_leaves(part, is_leaf)
    elif dataclasses.is_dataclass(tree):
        for part in vars(tree).values():
            yield from tree_leaves(part, is_leaf)


def tree_map(function: Callable[[Any], Any], tree: object, is_leaf: Callable[[Any], bool]) -> Any:
    """The pytree with a function of every leaf in its place. Designs are not validated anew: parts of valid batches
    are valid.
    """
    if is_leaf(tree):
        return function(tree)
    if isinstance(tree, tuple):
        parts = [tree_map(function, part, is_leaf) for part in tree]
        return type(tree)(*parts) if hasattr(tree, "_fields") else tuple(parts)
    if isinstance(tree, list):
        return [tree_map(function, part, is_leaf) for part in tree]
    if isinstance(tree, dict):
        return {key: tree_map(function, part, is_leaf) for key, part in tree.items()}
    if dataclasses.is_dataclass(tree) and any(True for _ in tree_leaves(tree, is_leaf)):
        copy = object.__new__(type(tree))
        vars(copy).update({key: tree_map(function, part, is_leaf) for key, part in vars(tree).items()})
        return copy
    return tree


def empty_matrix(rows: int, columns: int) -> np.ndarray:
    """An uninitialized matrix, whose rows may have gaps between them.

    Rows whose distance in memory is a power of two compete for the same few places of the processor's cache, which made
    the step of 1,024 environments half as fast as that of 1,000.
    """
    if columns % _CROWDED or rows < _FEW:
        return np.empty((rows, columns))
    return np.empty((rows, columns + _GAP))[:, :columns]


def as_matrix(array: object) -> np.ndarray:
    """An array of two dimensions as compiled code reads it: itself, if it is of float64 and its rows are unbroken."""
    given = np.asarray(array)
    if given.dtype == np.float64 and given.ndim == 2 and given.strides[1] == given.itemsize:
        return given
    matrix = empty_matrix(*given.shape)
    matrix[...] = given
    return matrix


def is_array(value: object) -> bool:
    """Whether a value varies along a batch."""
    return isinstance(value, np.ndarray)


class Row(int):
    """The row in which a component stands; `kind` is "float", "int" or "bool"."""

    kind: str

    def __new__(cls, number: int, kind: str = "float") -> "Row":
        """The row of that number."""
        row = int.__new__(cls, number)
        row.kind = kind
        return row


def is_row(value: object) -> bool:
    """Whether a value is the row of a component."""
    return isinstance(value, Row)


def _kind_of_array(array: np.ndarray) -> str:
    return {"b": "bool", "i": "int"}.get(array.dtype.kind, "float")


class Schema(Generic[T]):
    """Where the components of a pytree stand in a matrix.

    Args:
        tree: a pytree whose leaves tell which of its values vary; all others are kept as they are.
        is_leaf: tells the leaves; by default, arrays.
        kind: of a leaf's numbers; by default that of the array's.

    Attributes:
        rows: the pytree with the row of every component in its place.
        size: number of rows.
    """

    def __init__(
        self, tree: T, is_leaf: Callable[[Any], bool] = is_array, kind: Callable[[Any], str] = _kind_of_array
    ) -> None:
        numbers = count()
        self.rows: Any = tree_map(lambda leaf: Row(next(numbers), kind(leaf)), tree, is_leaf)
        self.size = next(numbers)

    def pack(self, tree: T, n: int) -> np.ndarray:
        """The matrix of a batch of n: shape (size, n)."""
        components = list(tree_leaves(tree, is_array))
        if len(components) != self.size:
            raise ValueError(f"{len(components)} components given, {self.size} expected")
        matrix = empty_matrix(self.size, n)
        for row, component in zip(matrix, components, strict=True):
            row[:] = component
        return matrix

    def unpack(self, matrix: np.ndarray) -> T:
        """The pytree on arrays of shape (n,); of a single column, of shape (size,), on numbers."""
        convert: dict[str, Callable[[Any], Any]]
        if matrix.ndim == 1:
            values: list[float] = matrix.tolist()
            convert = {"float": float, "int": int, "bool": bool}
            single: T = tree_map(lambda row: convert[row.kind](values[row]), self.rows, is_row)
            return single
        convert = {"float": lambda v: v, "int": lambda v: v.astype(np.int64), "bool": lambda v: v != 0}
        batch: T = tree_map(lambda row: convert[row.kind](matrix[row]), self.rows, is_row)
        return batch
