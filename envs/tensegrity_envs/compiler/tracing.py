"""Turn component code into straight-line source code, by running it on symbols.

The equations of this package are written once, on components. Run on `Symbol`s, they leave behind the list of their
operations: no repeated ones, none that a loop could do once before it begins. `kernel` makes machine code of that.
Python's own control flow happens while tracing; a branch on a symbol's value is an error (use `where`).
"""

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from tensegrity_envs.compiler.continuation import Rows
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.compiler.numbers import Number, derived


class Slot(NamedTuple):
    """A row of an array: the value of column n stands at [row, n]."""

    array: str
    row: int


class Input(NamedTuple):
    """A value that a function finds in some slot, from the given level on."""

    slot: Slot
    level: int
    kind: str


class Op(NamedTuple):
    """An operation.

    Attributes:
        name: of its result.
        code: what it does; see `loops`.
        arguments: names of other operations, of inputs and of constants, or numbers as they are written.
        level: how many paths have to be followed one after the other before its value is known.
        kind: of its result: "float", "int" or "bool".
    """

    name: str
    code: str
    arguments: tuple[str, ...]
    level: int
    kind: str


class Graph:
    """The operations of one function; a path's graph has that of the function around it as its parent.

    Attributes:
        ops: its operations, in an order in which they can be done.
        inputs: by name.
        stores: which values (names or numbers) the function leaves in which slots.
        captured: symbols of the parent that a path reads, by name, in rows from `first_captured` on.
        constants: names (c0, c1, ...) of the data of the outermost function and its paths, by where they come from.
        paths: that the function follows.
    """

    def __init__(self, parent: "Graph | None" = None, first_captured: int = 0) -> None:
        self.parent, self.first_captured = parent, first_captured
        self.depth: int = parent.depth + 1 if parent else 0
        self.ops: list[Op] = []
        self.inputs: dict[str, Input] = {}
        self.stores: list[tuple[Slot, str]] = []
        self.captured: dict[str, Symbol] = {}
        self.constants: dict[str, str] = {}
        self.paths: list[Path] = []
        self._known: dict[Any, Symbol] = {}

    @property
    def root(self) -> "Graph":
        """The outermost function."""
        return self.parent.root if self.parent else self

    def input(self, slot: Slot, kind: str = "float", level: int = 0) -> "Symbol":
        """The symbol of what stands in a slot, the same one for the same slot."""
        if slot not in self._known:
            name = f"x{len(self.inputs)}"
            self.inputs[name] = Input(slot, level, kind)
            self._known[slot] = Symbol(self, name, kind, level)
        return self._known[slot]

    def assign(self, code: str, arguments: Sequence["Symbol | str"], kind: str = "float") -> "Symbol":
        """The symbol of an operation, the same one for the same operation."""
        names = tuple(map(str, arguments))
        known = self._known.get((code, names))
        if known is None:
            name = f"v{len(self.ops)}"
            level = max((a.level for a in arguments if isinstance(a, Symbol)), default=0)
            self.ops.append(Op(name, code, names, level, kind))
            known = self._known[code, names] = Symbol(self, name, kind, level)
        return known

    def store(self, slot: Slot, value: Component) -> None:
        """Leave a symbol or a number in a slot."""
        self.stores.append((slot, str(self.local(value))))

    def close(self) -> None:
        """Forget what serves tracing alone."""
        self._known = {}
        for path in self.paths:
            path.graph.close()

    def local(self, value: Component) -> "Symbol | str":
        """A symbol or a number as this graph can use it.

        Numbers of designs, loads and limits become data, so that kernels that differ in them only share their code.
        """
        if isinstance(value, Symbol):
            if value.graph is self:
                return value
            assert self.parent is not None, "a symbol of an inner path was used outside of it"
            outer = self.parent.local(value)
            assert isinstance(outer, Symbol)
            self.captured[outer.name] = outer
            return self.input(Slot("w", self.first_captured + list(self.captured).index(outer.name)), outer.kind)
        if isinstance(value, Number):
            constants = self.root.constants
            return constants.setdefault(value.source, f"c{len(constants)}")
        return repr(value) if isinstance(value, bool | int) else repr(float(value))


class Symbol:
    """A number that is known only when the code runs."""

    __slots__ = ("graph", "kind", "level", "name")
    namespace: ClassVar[SimpleNamespace]  # see NAMESPACE
    __array_ufunc__ = None  # NumPy must leave arithmetic with symbols to them

    def __init__(self, graph: Graph, name: str, kind: str = "float", level: int = 0) -> None:
        self.graph, self.name, self.kind, self.level = graph, name, kind, level

    def __str__(self) -> str:
        return self.name

    def __bool__(self) -> bool:
        """Refuse to branch."""
        raise TypeError("component code must not branch on a value: use xp.where")

    def __neg__(self) -> "Symbol":
        return operation("neg", self)

    def __abs__(self) -> "Symbol":
        return operation("abs", self)

    def __invert__(self) -> "Symbol":
        return operation("not", self, kind="bool")

    def __pow__(self, power: float) -> "Symbol":
        if power == 0.5:
            return operation("sqrt", self)
        if isinstance(power, int) and 0 < power < 9:
            product = self
            for _ in range(power - 1):
                product = operation("mul", product, self)
            return product
        return operation("pow", self, power)


def operation(code: str, *arguments: Component, kind: str = "float") -> Symbol:
    """An operation on symbols and numbers, placed as far out as its arguments allow."""
    graph = None
    for argument in arguments:
        if isinstance(argument, Symbol) and (graph is None or argument.graph.depth > graph.depth):
            graph = argument.graph
    assert graph is not None
    return graph.assign(code, [graph.local(argument) for argument in arguments], kind)


def _operator(code: str, kind: str = "float", swapped: bool = False) -> Any:
    if swapped:
        return lambda a, b: operation(code, b, a, kind=kind)
    return lambda a, b: operation(code, a, b, kind=kind)


for _name in ("add", "sub", "mul", "truediv"):
    setattr(Symbol, f"__{_name}__", _operator(_name))
    setattr(Symbol, f"__r{_name}__", _operator(_name, swapped=True))
for _name in ("lt", "le", "gt", "ge", "eq", "ne"):
    setattr(Symbol, f"__{_name}__", _operator(_name, "bool"))
for _name in ("and", "or"):
    setattr(Symbol, f"__{_name}__", _operator(_name, "bool"))
    setattr(Symbol, f"__r{_name}__", _operator(_name, "bool"))
Symbol.__hash__ = object.__hash__  # type: ignore[method-assign]


def _function(code: str, of_floats: Callable[..., Any], kind: str = "float") -> Any:
    """A function that still takes plain numbers, with which it is evaluated while tracing."""

    def call(*arguments: Component) -> Component:
        if any(isinstance(argument, Symbol) for argument in arguments):
            return operation(code, *arguments, kind=kind)
        if any(isinstance(argument, Number) for argument in arguments):
            return derived(code, of_floats, *arguments)
        return of_floats(*arguments)

    return call


def _where(condition: Component, a: Component, b: Component) -> Component:
    if not isinstance(condition, Symbol):
        return a if condition else b
    kinds = {value.kind if isinstance(value, Symbol) else type(value).__name__ for value in (a, b)}
    kind = kinds.pop() if len(kinds) == 1 and kinds <= {"int", "bool"} else "float"
    return operation("where", condition, a, b, kind=kind)


NAMESPACE = SimpleNamespace(
    sin=_function("sine", math.sin),
    cos=_function("cosine", math.cos),
    sqrt=_function("sqrt", math.sqrt),
    log=_function("log", math.log),
    atan2=_function("atan2", math.atan2),
    # No lengths here are so large or small that their squares are not numbers.
    hypot=_function("hypot", math.hypot),
    minimum=_function("min", min),
    maximum=_function("max", max),
    where=_where,
    copysign=_function("copysign", math.copysign),
    isfinite=_function("isfinite", math.isfinite, "bool"),
    single=_function("single", lambda value: float(np.float32(value))),
)
Symbol.namespace = NAMESPACE
Number.namespace = NAMESPACE


class Path:
    """A path of equilibria that the traced function follows: the code of one Newton step along it."""

    def __init__(self, outer: Graph, size: int) -> None:
        self.outer, self.rows = outer, Rows(size)
        self.graph = Graph(outer, self.rows.captured)
        self.configuration = tuple(self.graph.input(Slot("w", row)) for row in range(size))
        self.parameter = self.graph.input(Slot("w", self.rows.parameter))
        self.level, self.resolution = 0, ""

    def finish(
        self,
        step: Sequence[Component],
        pivot: Component,
        volume: Component,
        start: Sequence[Component],
        resolution: float,
    ) -> tuple[Components, Component]:
        """Close the path's code with its results; let the function follow it, and return its end and fraction."""
        for row, value in enumerate((*step, pivot, volume), self.rows.step):
            self.graph.store(Slot("w", row), value)
        outer, array = self.outer, f"w{len(self.outer.paths)}"
        outer.paths.append(self)
        first = [*enumerate(start), *enumerate(self.graph.captured.values(), self.rows.captured)]
        for row, value in first:
            outer.store(Slot(array, row), value)
        self.resolution = str(outer.local(resolution))
        self.level = 1 + max((value.level for _, value in first if isinstance(value, Symbol)), default=0)
        end = tuple(outer.input(Slot(array, row), level=self.level) for row in range(len(start)))
        return end, outer.input(Slot(array, self.rows.parameter), level=self.level)
