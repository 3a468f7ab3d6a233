"""Traced functions: traced once for all that differ in numbers alone.

What a trace depends on is known before: the code of the function, and the structure of the objects that it uses, all
their integers, words and None included. Numbers are data; where the function compared one, that was noted. So a second
function of the same structure for which all that was noted holds has the same operations, and its data follow from its
own numbers by the noted arithmetic, to the last bit. The law in tests/compiler/test_traces.py compares that with a new
trace for every id. Functions of other packages are always traced: see `Lifting.is_known`.
"""

import types
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from tensegrity_envs.compiler.numbers import Lifting, Note, hash_of
from tensegrity_envs.compiler.pytree import Row, Schema, is_row, tree_leaves, tree_map
from tensegrity_envs.compiler.recent import Recent
from tensegrity_envs.compiler.tracing import Graph, Slot, Symbol

_ALIKE = 8  # traces of one structure, for functions that went other ways after comparing numbers


class Traced:
    """A traced function.

    Args:
        function: on numbers that know where they come from, as are those among the arguments.
        rows: its arguments, as rows.
        first: the row of its own matrix in which each begins, and the one after the last.
        notes: of what is computed from numbers meanwhile.

    Attributes:
        graph: its operations.
        result: schema of what it returns.
        first: as given.
    """

    def __init__(self, function: Callable[..., Any], rows: Sequence[Any], first: list[int], notes: list[Note]) -> None:
        self.graph = graph = Graph()
        self.first = first
        result = function(*(_symbols(graph, row, part) for row, part in zip(first, rows, strict=False)))
        self.result: Schema[Any] = Schema(result, _is_result, _result_kind)
        for row, value in enumerate(tree_leaves(result, _is_result), first[-1]):
            graph.store(Slot("w", row), value)
        graph.close()
        self._notes = _needed(notes, set(graph.constants))

    def constants(self, values: Mapping[str, float]) -> list[float] | None:
        """The data of a function of the same structure.

        Args:
            values: its numbers, by source.

        Returns:
            Them, or None if it is another function.
        """
        known: dict[str, Any] = dict(values)
        try:
            for result, function, arguments in self._notes:
                found = function(*[known[a] if isinstance(a, str) else a for a in arguments])
                if not isinstance(result, bool):
                    known[result] = found
                elif found is not result:
                    return None
        except (ArithmeticError, ValueError):
            return None  # tracing will tell what is wrong
        return [known[source] for source in self.graph.constants]


def traced(function: Callable[..., Any], schemas: Sequence[Schema[Any]]) -> tuple[Traced, list[float]]:
    """A traced function of arguments of these schemas, and its data."""
    first = [sum(schema.size for schema in schemas[:k]) for k in range(len(schemas) + 1)]
    lifting = Lifting()
    rows = [lifting.lift(schema.rows, f"argument {k}") for k, schema in enumerate(schemas)]
    own = _lifted(function, lifting)
    values = dict(lifting.values)
    key = hash_of("\n".join(lifting.structure)), *lifting.objects
    alike = (_KNOWN.get(key) or ()) if lifting.is_known else ()
    for one in alike:
        data = one.constants(values)
        if data is not None:
            return one, data
    new = Traced(own, rows, first, lifting.notes)
    if lifting.is_known:
        _KNOWN.put(key, (new, *alike[: _ALIKE - 1]))
    data = new.constants(values)
    assert data is not None
    return new, data


_KNOWN: Recent[Any, tuple[Traced, ...]] = Recent(256)


def _needed(notes: list[Note], wanted: set[str]) -> list[Note]:
    """What has to be computed, and all that the function has learned."""
    kept = []
    for note in reversed(dict.fromkeys(notes)):  # what was computed twice, where it was first
        if isinstance(note.result, bool) or note.result in wanted:
            kept.append(note)
            wanted.update(a for a in note.arguments if isinstance(a, str))
    return kept[::-1]


def _symbols(graph: Graph, first: int, rows: object) -> Any:
    """The pytree of a schema on symbols that are read from the rows from `first` on."""
    return tree_map(lambda row: graph.input(Slot("w", first + row), row.kind), rows, is_row)


def _is_result(value: object) -> bool:
    return isinstance(value, Symbol | bool | int | float | np.number) and not isinstance(value, Row)


def _result_kind(value: object) -> str:
    if isinstance(value, Symbol):
        return value.kind
    return {bool: "bool", int: "int"}.get(type(value), "float")


def _lifted(function: Callable[..., Any], lifting: Lifting) -> Callable[..., Any]:
    """The function on numbers that know where they come from, of the objects that it belongs to or encloses."""
    owner = getattr(function, "__self__", None)
    if owner is not None:
        lifting.tell_function(getattr(function, "__func__", function))
        method: Callable[..., Any] = getattr(lifting.lift(owner, type(owner).__name__), function.__name__)
        return method
    lifting.tell_function(function)
    if not isinstance(function, types.FunctionType) or not function.__closure__:
        return function
    cells = []
    for name, cell in zip(function.__code__.co_freevars, function.__closure__, strict=True):
        value = cell.cell_contents
        own = isinstance(value, types.FunctionType | types.MethodType)
        cells.append(types.CellType(_lifted(value, lifting) if own else lifting.lift(value, name)))
    code, defaults = function.__code__, function.__defaults__
    return types.FunctionType(code, function.__globals__, function.__name__, defaults, tuple(cells))
