"""Turn component code into straight-line source code, by running it on symbols.

The equations of this package are written once, on components. Run on `Symbol`s, they leave behind the list of their
operations: no repeated ones, none that a loop could do once before it begins. `compiling` makes machine code of that.
Python's own control flow happens while tracing; a branch on a symbol's value is an error (use `where`).
"""

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any


class Graph:
    """The operations of one function; a path's graph has that of the function around it as its parent."""

    def __init__(self, parent: "Graph | None" = None) -> None:
        self.parent = parent
        self.lines: list[str] = []
        self.captured: list[str] = []  # names in the parent that this graph reads
        self.constants: list[float] = []
        self.paths: list[Path] = []
        self._known: dict[Any, Symbol] = {}
        self._count = 0

    @property
    def root(self) -> "Graph":
        """The outermost function."""
        return self.parent.root if self.parent else self

    def assign(self, expression: str, kind: str = "float") -> "Symbol":
        """The symbol of an expression, the same one for the same expression."""
        if expression not in self._known:
            name = f"v{self._count}"
            self._count += 1
            self.lines.append(f"{name} = {expression}")
            self._known[expression] = Symbol(self, name, kind)
        return self._known[expression]

    def local(self, value: Any) -> str:
        """How a symbol or a number is written inside this graph.

        Floating-point constants become data, so that designs that differ in numbers only share their code.
        """
        if isinstance(value, Symbol):
            if value.graph is self:
                return value.name
            assert self.parent is not None, "a symbol of an inner path was used outside of it"
            outer = self.parent.local(value)
            if outer not in self.captured:
                self.captured.append(outer)
            return self.assign(f"p[{self.captured.index(outer)}]").name
        if isinstance(value, bool | int):
            return repr(value)
        value = float(value)
        root = self.root
        key = ("constant", repr(value))
        if key not in root._known:
            root.constants.append(value)
            root._known[key] = root.assign(f"c[{len(root.constants) - 1}]")
        return self.local(root._known[key])


class Symbol:
    """A number that is known only when the code runs."""

    __slots__ = ("graph", "kind", "name")
    __array_ufunc__ = None  # NumPy must leave arithmetic with symbols to them

    def __init__(self, graph: Graph, name: str, kind: str = "float") -> None:
        self.graph, self.name, self.kind = graph, name, kind

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
        return operation("{} * {}", self, self) if power == 2 else operation("{} ** {}", self, power)


def _depth(graph: Graph) -> int:
    return 1 + _depth(graph.parent) if graph.parent else 0


def operation(template: str, *arguments: Any, kind: str = "float") -> Symbol:
    """An operation on symbols and numbers, placed as far out as its arguments allow."""
    graph = max((a.graph for a in arguments if isinstance(a, Symbol)), key=_depth)
    return graph.assign(template.format(*map(graph.local, arguments)), kind)


def _operator(template: str, kind: str = "float", swapped: bool = False) -> Any:
    if swapped:
        return lambda a, b: operation(template, b, a, kind=kind)
    return lambda a, b: operation(template, a, b, kind=kind)


for _name, _sign in (("add", "+"), ("sub", "-"), ("mul", "*"), ("truediv", "/")):
    setattr(Symbol, f"__{_name}__", _operator(f"{{}} {_sign} {{}}"))
    setattr(Symbol, f"__r{_name}__", _operator(f"{{}} {_sign} {{}}", swapped=True))
for _name, _sign in (("lt", "<"), ("le", "<="), ("gt", ">"), ("ge", ">="), ("eq", "=="), ("ne", "!=")):
    setattr(Symbol, f"__{_name}__", _operator(f"{{}} {_sign} {{}}", "bool"))
for _name, _sign in (("and", "and"), ("or", "or")):
    setattr(Symbol, f"__{_name}__", _operator(f"{{}} {_sign} {{}}", "bool"))
    setattr(Symbol, f"__r{_name}__", _operator(f"{{}} {_sign} {{}}", "bool"))
Symbol.__hash__ = object.__hash__  # type: ignore[method-assign]


def _function(template: str, of_floats: Callable[..., Any], kind: str = "float") -> Any:
    """A function that still takes plain numbers, with which it is evaluated while tracing."""

    def call(*arguments: Any) -> Any:
        if any(isinstance(argument, Symbol) for argument in arguments):
            return operation(template, *arguments, kind=kind)
        return of_floats(*arguments)

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
    sin=_function("math.sin({})", math.sin),
    cos=_function("math.cos({})", math.cos),
    sqrt=_function("math.sqrt({})", math.sqrt),
    atan2=_function("math.atan2({}, {})", math.atan2),
    hypot=_function("math.hypot({}, {})", math.hypot),
    minimum=_function("min({}, {})", min),
    maximum=_function("max({}, {})", max),
    where=_where,
    isfinite=_function("math.isfinite({})", math.isfinite, "bool"),
    single=_function("float(np.float32({}))", lambda value: value),
)
Symbol.namespace = NAMESPACE  # type: ignore[attr-defined]


class Path:
    """A path of equilibria that the traced function follows: the code of one Newton step along it."""

    def __init__(self, outer: Graph, size: int) -> None:
        self.outer, self.size = outer, size
        self.graph = Graph(outer)
        self.configuration = tuple(Symbol(self.graph, f"q[{i}]") for i in range(size))
        self.parameter = Symbol(self.graph, "t")
        self.results: list[str] = []

    def finish(self, results: Sequence[Any], start: Sequence[Any], resolution: float) -> tuple[tuple[Any, ...], Any]:
        """Close the path's code with its results; emit the call that follows it, and return its end and fraction."""
        self.results = [self.graph.local(result) for result in results]
        k, outer = len(self.outer.paths), self.outer
        self.outer.paths.append(self)
        for i, name in enumerate(self.graph.captured):
            outer.lines.append(f"p{k}[{i}] = {name}")
        for i, value in enumerate(start):
            outer.lines.append(f"q{k}[{i}] = {outer.local(value)}")
        # Numbered: two paths followed one after the other are two calls, never one repeated expression.
        fraction = outer.assign(f"follow_{k}(p{k}, q{k}, w{k}, {outer.local(resolution)})")
        end = tuple(outer.assign(f"q{k}[{i}]") for i in range(self.size))
        return end, fraction
