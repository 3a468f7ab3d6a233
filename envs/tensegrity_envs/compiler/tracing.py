"""Turn component code into straight-line source code, by running it on symbols.

The equations of this package are written once, on components. Run on `Symbol`s, they leave behind the list of their
operations: no repeated ones, none that a loop could do once before it begins. `kernel` makes machine code of that.
Python's own control flow happens while tracing; a branch on a symbol's value is an error (use `where`).
"""

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

from tensegrity_envs.compiler.continuation import Rows


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
        expression: on the names of other operations, of inputs and of constants.
        arguments: those of them that are operations or inputs.
        level: how many calls its value depends on, its own included.
        is_call: whether it is a call, and not arithmetic.
        kind: of its result: "float", "int" or "bool".
    """

    name: str
    expression: str
    arguments: tuple[str, ...]
    level: int
    is_call: bool
    kind: str


class Graph:
    """The operations of one function; a path's graph has that of the function around it as its parent.

    Attributes:
        ops: its operations, in an order in which they can be done.
        inputs: by name.
        stores: which values (names or numbers) the function leaves in which slots.
        captured: symbols of the parent that a path reads, by name, in rows from `first_captured` on.
        constants: of the outermost function and its paths, by how they are written; c0, c1, ... are their names.
        paths: that the function follows.
    """

    def __init__(self, parent: "Graph | None" = None, first_captured: int = 0) -> None:
        self.parent, self.first_captured = parent, first_captured
        self.ops: list[Op] = []
        self.inputs: dict[str, Input] = {}
        self.stores: list[tuple[Slot, str]] = []
        self.captured: dict[str, Symbol] = {}
        self.constants: dict[str, float] = {}
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

    def assign(
        self, expression: str, arguments: Sequence["Symbol"], kind: str = "float", is_call: bool = False
    ) -> "Symbol":
        """The symbol of an expression, the same one for the same expression."""
        if expression not in self._known:
            name, level = f"v{len(self.ops)}", max((a.level for a in arguments), default=0) + is_call
            self.ops.append(Op(name, expression, tuple(a.name for a in arguments), level, is_call, kind))
            self._known[expression] = Symbol(self, name, kind, level)
        return self._known[expression]

    def store(self, slot: Slot, value: Any) -> None:
        """Leave a symbol or a number in a slot."""
        self.stores.append((slot, str(self.local(value))))

    def local(self, value: Any) -> "Symbol | str":
        """A symbol or a number as this graph can use it.

        Floating-point constants become data, so that designs that differ in numbers only share their code.
        """
        if isinstance(value, Symbol):
            if value.graph is self:
                return value
            assert self.parent is not None, "a symbol of an inner path was used outside of it"
            outer = self.parent.local(value)
            assert isinstance(outer, Symbol)
            self.captured[outer.name] = outer
            return self.input(Slot("w", self.first_captured + list(self.captured).index(outer.name)))
        if isinstance(value, bool | int):
            return repr(value)
        constants, number = self.root.constants, float(value)
        constants[repr(number)] = number
        return f"c{list(constants).index(repr(number))}"


class Symbol:
    """A number that is known only when the code runs."""

    __slots__ = ("graph", "kind", "level", "name")
    __array_ufunc__ = None  # NumPy must leave arithmetic with symbols to them

    def __init__(self, graph: Graph, name: str, kind: str = "float", level: int = 0) -> None:
        self.graph, self.name, self.kind, self.level = graph, name, kind, level

    def __str__(self) -> str:
        return self.name

    def __bool__(self) -> bool:
        """Refuse to branch."""
        raise TypeError("component code must not branch on a value: use xp.where")

    def __neg__(self) -> "Symbol":
        return operation("-{}", self)

    def __abs__(self) -> "Symbol":
        return operation("abs({})", self)

    def __invert__(self) -> "Symbol":
        return operation("not {}", self, kind="bool")

    def __pow__(self, power: float) -> "Symbol":
        if power == 0.5:
            return operation("math.sqrt({})", self)
        return operation("{} * {}", self, self) if power == 2 else operation("{} ** {}", self, power, is_call=True)


def _depth(graph: Graph) -> int:
    return 1 + _depth(graph.parent) if graph.parent else 0


def operation(template: str, *arguments: Any, kind: str = "float", is_call: bool = False) -> Symbol:
    """An operation on symbols and numbers, placed as far out as its arguments allow."""
    graph = max((a.graph for a in arguments if isinstance(a, Symbol)), key=_depth)
    local = [graph.local(argument) for argument in arguments]
    return graph.assign(template.format(*local), [a for a in local if isinstance(a, Symbol)], kind, is_call)


def _operator(template: str, kind: str = "float", swapped: bool = False) -> Any:
    if swapped:
        return lambda a, b: operation(template, b, a, kind=kind)
    return lambda a, b: operation(template, a, b, kind=kind)


for _name, _sign in (("add", "+"), ("sub", "-"), ("mul", "*"), ("truediv", "/")):
    setattr(Symbol, f"__{_name}__", _operator(f"{{}} {_sign} {{}}"))
    setattr(Symbol, f"__r{_name}__", _operator(f"{{}} {_sign} {{}}", swapped=True))
for _name, _sign in (("lt", "<"), ("le", "<="), ("gt", ">"), ("ge", ">="), ("eq", "=="), ("ne", "!=")):
    setattr(Symbol, f"__{_name}__", _operator(f"{{}} {_sign} {{}}", "bool"))
for _name, _sign in (("and", "&"), ("or", "|")):
    setattr(Symbol, f"__{_name}__", _operator(f"{{}} {_sign} {{}}", "bool"))
    setattr(Symbol, f"__r{_name}__", _operator(f"{{}} {_sign} {{}}", "bool"))
Symbol.__hash__ = object.__hash__  # type: ignore[method-assign]


def _function(template: str, of_floats: Callable[..., Any], kind: str = "float", is_call: bool = False) -> Any:
    """A function that still takes plain numbers, with which it is evaluated while tracing."""

    def call(*arguments: Any) -> Any:
        if any(isinstance(argument, Symbol) for argument in arguments):
            return operation(template, *arguments, kind=kind, is_call=is_call)
        return of_floats(*arguments)

    return call


def _one_of(template: str, index: int, of_floats: Callable[..., Any]) -> Any:
    """As `_function`, one of the results of a function that has several."""

    def call(argument: Any) -> Any:
        if isinstance(argument, Symbol):
            return operation(f"{{}}[{index}]", operation(template, argument))
        return of_floats(argument)

    return call


def _where(condition: Any, a: Any, b: Any) -> Any:
    if not isinstance(condition, Symbol):
        return a if condition else b
    kinds = {value.kind if isinstance(value, Symbol) else type(value).__name__ for value in (a, b)}
    return operation(
        "{1} if {0} else {2}",
        condition,
        a,
        b,
        kind=kinds.pop() if len(kinds) == 1 and "float" not in kinds else "float",
    )


NAMESPACE = SimpleNamespace(
    sin=_one_of("sine_and_cosine({})", 0, math.sin),
    cos=_one_of("sine_and_cosine({})", 1, math.cos),
    sqrt=_function("math.sqrt({})", math.sqrt),
    atan2=_function("math.atan2({}, {})", math.atan2, is_call=True),
    # No lengths here are so large or small that their squares are not numbers.
    hypot=_function("math.sqrt({0} * {0} + {1} * {1})", math.hypot),
    minimum=_function("min({}, {})", min),
    maximum=_function("max({}, {})", max),
    where=_where,
    isfinite=_function("math.isfinite({})", math.isfinite, "bool"),
    single=_function("np.float64(np.float32({}))", lambda value: value),
)
Symbol.namespace = NAMESPACE  # type: ignore[attr-defined]


class Path:
    """A path of equilibria that the traced function follows: the code of one Newton step along it."""

    def __init__(self, outer: Graph, size: int) -> None:
        self.outer, self.rows = outer, Rows(size)
        self.graph = Graph(outer, self.rows.captured)
        self.configuration = tuple(self.graph.input(Slot("w", row)) for row in range(size))
        self.parameter = self.graph.input(Slot("w", self.rows.parameter))
        self.level, self.resolution = 0, ""

    def finish(
        self, step: Sequence[Any], pivot: Any, volume: Any, start: Sequence[Any], resolution: float
    ) -> tuple[tuple[Any, ...], Any]:
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
