"""The operations of a traced function as loops over the columns of a matrix, in LLVM's intermediate representation.

A row of the working matrix `w` has `BLOCK` numbers, one for each environment; an instruction does the arithmetic of
`LANES` of them. The compiler need not find out that columns do not depend on one another, and there is one version of
the code: what one column gives is what it gives among many, to the last bit. The operations before a path is followed
are one such loop, those after it another; values that cross over are kept in rows of their own.
"""

import math
from collections import defaultdict
from collections.abc import Callable
from typing import Any

from tensegrity_envs.compiler import sines
from tensegrity_envs.compiler.lowering import number
from tensegrity_envs.compiler.tracing import NAMESPACE, Graph, Input, Slot

BLOCK = 16  # columns: two lines of the processor's cache
LANES = 8
_F, _B = f"<{LANES} x double>", f"<{LANES} x i1>"
_BINARY = {"add": "fadd", "sub": "fsub", "mul": "fmul", "truediv": "fdiv"}
_COMPARE = {"lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge", "eq": "oeq", "ne": "une"}
_PAIR = f"{{ {_F}, {_F} }}"
# What `loops` calls; sines, cosines and arc tangents are component code themselves.
DECLARATIONS = "\n".join(
    f"declare {_F} @llvm.{name}.v{LANES}f64({', '.join([_F] * count)})"
    for name, count in (("sqrt", 1), ("fabs", 1), ("copysign", 2), ("pow", 2), ("log", 1))
)


def loops(graph: Graph, first: int) -> tuple[dict[int, list[str]], int]:
    """The body of one loop for every level of a function on the matrix `w`.

    In all of them `%g` is the first of the columns, and `%c` are the constants.

    Args:
        graph: of the function.
        first: row from which on the function may keep values between its loops.

    Returns:
        The bodies by level, and how many rows there must be.
    """
    ops = {op.name: op for op in graph.ops}
    slots = defaultdict(list)  # in which to leave a value, by its name
    for slot, name in graph.stores:
        slots[name].append(slot)
    inputs = dict(graph.inputs)
    row = first
    for op in graph.ops:
        for name in op.arguments:
            if name not in inputs and name in ops and ops[name].level != op.level:
                inputs[name] = Input(Slot("w", row), ops[name].level, ops[name].kind)
                slots[name].append(inputs[name].slot)
                row += 1
    bodies: dict[int, _Body] = defaultdict(lambda: _Body(inputs))
    for op in graph.ops:
        body = bodies[op.level]
        body.do(op.name, op.code, op.arguments, op.kind)
        for slot in slots.pop(op.name, []):
            body.store(slot, op.name)
    for name, places in slots.items():  # inputs and constants
        for slot in places:
            bodies[inputs[name].level if name in inputs else 0].store(slot, name)
    return {level: body.lines for level, body in sorted(bodies.items())}, row


class _Body:
    """The lines of one loop's body."""

    def __init__(self, inputs: dict[str, Input]) -> None:
        self.inputs = inputs
        self.lines: list[str] = []
        self.count = 0
        self.known: dict[str, tuple[str, str]] = {}  # text and type by name
        self.pointers: set[str] = set()

    def emit(self, text: str) -> str:
        self.count += 1
        self.lines.append(f"  %t{self.count} = {text}")
        return f"%t{self.count}"

    def address(self, slot: Slot) -> str:
        if slot.array not in self.pointers:
            self.lines.append(f"  %g.{slot.array} = getelementptr double, ptr %{slot.array}, i64 %g")
            self.pointers.add(slot.array)
        return self.emit(f"getelementptr double, ptr %g.{slot.array}, i64 {slot.row * BLOCK}")

    def value(self, name: str, wanted: str = _F) -> str:
        """What a name stands for, of the wanted type."""
        if name not in self.known:
            self.known[name] = self._read(name)
        text, kind = self.known[name]
        if kind == wanted:
            return text
        if wanted == _F:
            return self.emit(f"uitofp {kind} {text} to {_F}")
        return self.emit(f"fcmp une {_F} {text}, zeroinitializer")

    def _read(self, name: str) -> tuple[str, str]:
        if name in self.inputs:
            loaded = self.emit(f"load {_F}, ptr {self.address(self.inputs[name].slot)}, align 8")
            if self.inputs[name].kind == "bool":
                return self.emit(f"fcmp une {_F} {loaded}, zeroinitializer"), _B
            return loaded, _F
        if name in ("True", "False"):
            return f"splat (i1 {name.lower()})", _B
        if name[0] == "c":
            address = self.emit(f"getelementptr double, ptr %c, i64 {name[1:]}")
            scalar = self.emit(f"load double, ptr {address}, align 8")
            one = self.emit(f"insertelement {_F} poison, double {scalar}, i64 0")
            return self.emit(f"shufflevector {_F} {one}, {_F} poison, <{LANES} x i32> zeroinitializer"), _F
        return f"splat (double {number(float(name))})", _F

    def store(self, slot: Slot, name: str) -> None:
        value = self.value(name)
        self.lines.append(f"  store {_F} {value}, ptr {self.address(slot)}, align 8")

    def do(self, name: str, code: str, arguments: tuple[str, ...], kind: str) -> None:
        """An operation."""
        self.known[name] = self._do(code, arguments, kind), _B if kind == "bool" else _F

    def _do(self, code: str, arguments: tuple[str, ...], kind: str) -> str:
        if code in ("and", "or", "not") or (code in ("eq", "ne") and self._are_conditions(arguments)):
            a, *rest = (self.value(name, _B) for name in arguments)
            if code == "not":
                return self.emit(f"xor {_B} {a}, splat (i1 true)")
            how = {"and": "and", "or": "or", "ne": "xor", "eq": "icmp eq"}[code]
            return self.emit(f"{how} {_B} {a}, {rest[0]}")
        if code == "where":
            condition = self.value(arguments[0], _B)
            wanted = _B if kind == "bool" else _F
            one, other = (self.value(name, wanted) for name in arguments[1:])
            return self.emit(f"select {_B} {condition}, {wanted} {one}, {wanted} {other}")
        a, *rest = (self.value(name) for name in arguments)
        b = rest[0] if rest else ""
        if code in _BINARY:
            return self.emit(f"{_BINARY[code]} {_F} {a}, {b}")
        if code in _COMPARE:
            return self.emit(f"fcmp {_COMPARE[code]} {_F} {a}, {b}")
        if code in ("min", "max"):  # as in Python: the first one, unless the second is smaller
            better = self.emit(f"fcmp {'olt' if code == 'min' else 'ogt'} {_F} {b}, {a}")
            return self.emit(f"select {_B} {better}, {_F} {b}, {_F} {a}")
        if code == "neg":
            return self.emit(f"fneg {_F} {a}")
        if code == "hypot":
            squares = [self.emit(f"fmul {_F} {x}, {x}") for x in (a, b)]
            return self._call("sqrt", self.emit(f"fadd {_F} {squares[0]}, {squares[1]}"))
        if code == "isfinite":
            size = self._call("fabs", a)
            return self.emit(f"fcmp olt {_F} {size}, splat (double {number(math.inf)})")
        if code == "single":
            single = self.emit(f"fptrunc {_F} {a} to <{LANES} x float>")
            return self.emit(f"fpext <{LANES} x float> {single} to {_F}")
        if code in ("sine", "cosine"):
            key = f"sines of {arguments[0]}"
            if key not in self.known:
                self.known[key] = self.emit(f"call {_PAIR} @sine_and_cosine({_F} {a})"), _PAIR
            return self.emit(f"extractvalue {_PAIR} {self.known[key][0]}, {int(code == 'cosine')}")
        if code == "atan2":
            return self.emit(f"call {_F} @arc_tangent({_F} {a}, {_F} {b})")
        return self._call({"abs": "fabs"}.get(code, code), a, *rest)

    def _are_conditions(self, arguments: tuple[str, ...]) -> bool:
        for name in arguments:
            self.value(name, self.known.get(name, ("", _F))[1])
        return all(self.known[name][1] == _B for name in arguments)

    def _call(self, name: str, *values: str) -> str:
        listed = ", ".join(f"{_F} {value}" for value in values)
        return self.emit(f"call {_F} @llvm.{name}.v{LANES}f64({listed})")


def _function(name: str, component_code: Callable[..., Any], count: int) -> str:
    """A function of component code on vectors, which has no constants but those that are written out."""
    graph = Graph()
    arguments = [graph.input(Slot("argument", k)) for k in range(count)]
    results = component_code(NAMESPACE, *arguments)
    results = results if isinstance(results, tuple) else (results,)
    body = _Body(graph.inputs)
    body.known = {f"x{k}": (f"%a{k}", _F) for k in range(count)}
    for op in graph.ops:
        body.do(op.name, op.code, op.arguments, op.kind)
    given = ", ".join(f"{_F} %a{k}" for k in range(count))
    values = [body.value(str(value)) for value in results]
    if len(values) == 1:
        kind, last = _F, values[0]
    else:
        kind = _PAIR
        half = body.emit(f"insertvalue {_PAIR} poison, {_F} {values[0]}, 0")
        last = body.emit(f"insertvalue {_PAIR} {half}, {_F} {values[1]}, 1")
    return "\n".join(
        [f"define internal {kind} @{name}({given}) alwaysinline {{", *body.lines, f"  ret {kind} {last}", "}"]
    )


def functions() -> str:
    """The functions that loops call."""
    return "\n".join(
        [
            DECLARATIONS,
            _function("sine_and_cosine", sines.sine_and_cosine, 1),
            _function("arc_tangent", sines.arc_tangent, 2),
        ]
    )
