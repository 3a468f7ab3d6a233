"""Plain loops on numbers and arrays, as LLVM's intermediate representation.

What is written as a loop by hand (continuation, the sines, all roots of a polynomial) is a Python function in a small
part of the language, which runs as it stands, too. Its arguments are annotated:

    int, float, bool     a number
    Vector, Matrix       an array of float64 of one or two dimensions, C-contiguous
    Rows                 a matrix whose rows may have gaps between them; its shape[1] is the distance from row to row
    Table                an array of float32 of two dimensions
    Integers, Booleans   an array of int64 or of bool, of one dimension
    IntegerTable, BooleanTable      the same, of two dimensions

Statements: assignment of names and elements, `for ... in range(...)`, `while`, `if`, `break`, `continue`, `return`
without a value. Expressions: arithmetic, comparison, `and`, `or`, `not`, `a if b else c`, all of whose parts are
evaluated; `abs`, `min`, `max`, `len`, `int`, `float`, `x.shape[k]`, some functions of `math` and NumPy, `np.zeros` and
`np.empty` (outside of loops), and calls of other such functions. Names from outside are numbers or such functions.
Arithmetic is that of NumPy: a division by zero is infinite, and no error. An index is not checked.
"""

import ast
import inspect
import struct
import textwrap
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple, TypeAlias

Vector: TypeAlias = Any
Matrix: TypeAlias = Any
Rows: TypeAlias = Any
Table: TypeAlias = Any
Integers: TypeAlias = Any
Booleans: TypeAlias = Any
IntegerTable: TypeAlias = Any
BooleanTable: TypeAlias = Any
_KINDS = {
    "Vector": (1, "double"),
    "Matrix": (2, "double"),
    "Rows": (2, "double"),
    "Table": (2, "float"),
    "Integers": (1, "i64"),
    "Booleans": (1, "i8"),
    "IntegerTable": (2, "i64"),
    "BooleanTable": (2, "i8"),
}
DIMENSIONS = {name: dimensions for name, (dimensions, _) in _KINDS.items()}
_ELEMENT = {name: element for name, (_, element) in _KINDS.items()}
_COMPARE = {
    ast.Lt: ("olt", "slt"),
    ast.LtE: ("ole", "sle"),
    ast.Gt: ("ogt", "sgt"),
    ast.GtE: ("oge", "sge"),
    ast.Eq: ("oeq", "eq"),
    ast.NotEq: ("une", "ne"),
}
_ARITHMETIC = {ast.Add: ("fadd", "add"), ast.Sub: ("fsub", "sub"), ast.Mult: ("fmul", "mul")}
_OF_FLOATS = {"sqrt": "llvm.sqrt.f64", "floor": "llvm.floor.f64", "rint": "llvm.rint.f64"}
# What the functions of this module call; `declare` for every module.
DECLARATIONS = """
declare double @llvm.sqrt.f64(double)
declare double @llvm.fabs.f64(double)
declare double @llvm.floor.f64(double)
declare double @llvm.rint.f64(double)
declare double @llvm.pow.f64(double, double)
declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)
"""


def number(value: float) -> str:
    """A number as LLVM reads it, to the bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


class Value(NamedTuple):
    """A number: its name or text, and its type: "double", "i64" or "i1"."""

    text: str
    type: str


class Array(NamedTuple):
    """An array: its address, the type of its elements, and its shape."""

    address: str
    element: str
    shape: tuple[Value, ...]


@cache
def _definition(function: Callable[..., Any]) -> ast.FunctionDef:
    definition = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(definition, ast.FunctionDef)
    return definition


def parameters_of(function: Callable[..., Any]) -> list[tuple[str, str]]:
    """Names and annotations of a function's parameters."""
    return [
        (argument.arg, ast.unparse(argument.annotation).rpartition(".")[2])
        for argument in _definition(function).args.args
        if argument.annotation is not None
    ]


def lower(function: Callable[..., Any], name: str, functions: Mapping[str, str], linkage: str = "internal") -> str:
    """The definition of a function.

    Args:
        function: see above.
        name: of it in LLVM.
        functions: those that it calls: by their names in Python, the names in LLVM.
        linkage: LLVM's.
    """
    return _Lowering(function, name, functions, linkage).text


class _Lowering:
    def __init__(self, function: Callable[..., Any], name: str, functions: Mapping[str, str], linkage: str) -> None:
        self.functions = functions
        outside = inspect.getclosurevars(function)
        self.outside = {**outside.globals, **outside.nonlocals}
        self.allocations: list[str] = []
        self.lines: list[str] = []
        self.count = 0
        self.locals: dict[str, Value | Array] = {}  # a number's text is its address
        self.targets: list[tuple[str, str]] = []  # of continue and break
        arguments = []
        for parameter, kind in parameters_of(function):
            if kind in DIMENSIONS:
                sizes = [f"%{parameter}.{k}" for k in range(DIMENSIONS[kind])]
                arguments += [f"ptr noalias %{parameter}", *(f"i64 {size}" for size in sizes)]
                shape = tuple(Value(size, "i64") for size in sizes)
                self.locals[parameter] = Array(f"%{parameter}", _ELEMENT[kind], shape)
            else:
                of_kind = {"int": "i64", "float": "double", "bool": "i1"}[kind]
                arguments.append(f"{of_kind} %{parameter}")
                self.assign(parameter, Value(f"%{parameter}", of_kind))
        self.block(_definition(function).body)
        head = f"define {linkage} void @{name}({', '.join(arguments)}) {{"
        self.text = "\n".join([head, "entry:", *self.allocations, *self.lines, "  ret void", "}"])

    # ------------------------------------------------------------------------------------------------- the basics

    def new(self) -> str:
        self.count += 1
        return f"%t{self.count}"

    def emit(self, text: str, kind: str) -> Value:
        name = self.new()
        self.lines.append(f"  {name} = {text}")
        return Value(name, kind)

    def label(self, name: str) -> None:
        self.lines += [f"  br label %{name}", f"{name}:"]

    def labels(self, *names: str) -> list[str]:
        self.count += 1
        return [f"{name}{self.count}" for name in names]

    def to(self, value: Value, kind: str) -> Value:
        """The value as another type."""
        if value.type == kind:
            return value
        if kind == "double":
            if value.type == "i64" and value.text.lstrip("-").isdigit():
                return Value(number(float(value.text)), kind)
            return self.emit(
                f"{'sitofp' if value.type == 'i64' else 'uitofp'} {value.type} {value.text} to double", kind
            )
        if kind == "i64":
            how = "fptosi" if value.type == "double" else "zext"
            return self.emit(f"{how} {value.type} {value.text} to i64", kind)
        return self.emit(f"icmp ne {value.type} {value.text}, 0", "i1")

    def common(self, *values: Value) -> tuple[list[Value], str]:
        kinds = {value.type for value in values}
        kind = "double" if "double" in kinds else "i64" if "i64" in kinds else "i1"
        return [self.to(value, kind) for value in values], kind

    def assign(self, name: str, value: Value | Array) -> None:
        if isinstance(value, Array):
            self.locals[name] = value
            return
        if name not in self.locals:
            self.allocations.append(f"  %v.{name} = alloca {value.type}")
            self.locals[name] = Value(f"%v.{name}", value.type)
        place = self.locals[name]
        assert isinstance(place, Value)
        value = self.to(value, place.type)
        self.lines.append(f"  store {value.type} {value.text}, ptr {place.text}")

    def element(self, node: ast.Subscript) -> tuple[str, str]:
        """Address and type of an element."""
        array = self.array(node.value)
        index = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if len(index) != len(array.shape):
            raise TypeError(f"{ast.unparse(node)}: needs {len(array.shape)} indices")
        at = self.to(self.value(index[0]), "i64")
        for size, part in zip(array.shape[1:], index[1:], strict=True):
            row = self.emit(f"mul nsw i64 {at.text}, {size.text}", "i64")
            at = self.emit(f"add nsw i64 {row.text}, {self.to(self.value(part), 'i64').text}", "i64")
        address = self.emit(f"getelementptr inbounds {array.element}, ptr {array.address}, i64 {at.text}", "ptr")
        return address.text, array.element

    def array(self, node: ast.expr) -> Array:
        found = self.locals.get(node.id) if isinstance(node, ast.Name) else None
        if not isinstance(found, Array):
            raise TypeError(f"{ast.unparse(node)} is no array")
        return found

    # ------------------------------------------------------------------------------------------------- statements

    def block(self, statements: list[ast.stmt]) -> None:
        for statement in statements:
            getattr(self, f"do_{type(statement).__name__}", self.refuse)(statement)

    def refuse(self, node: ast.AST) -> Any:
        raise TypeError(f"{ast.unparse(node)}: is not in the part of Python that is lowered")

    def do_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return  # a docstring
        if not isinstance(node.value, ast.Call) or not isinstance(node.value.func, ast.Name):
            self.refuse(node)
        assert isinstance(node.value, ast.Call) and isinstance(node.value.func, ast.Name)
        called = self.outside[node.value.func.id]
        arguments = []
        for part, (_, kind) in zip(node.value.args, parameters_of(called), strict=True):
            if kind in DIMENSIONS:
                array = self.array(part)
                arguments += [f"ptr {array.address}", *(f"i64 {size.text}" for size in array.shape)]
            else:
                value = self.to(self.value(part), {"int": "i64", "float": "double", "bool": "i1"}[kind])
                arguments.append(f"{value.type} {value.text}")
        self.lines.append(f"  call void @{self.functions[node.value.func.id]}({', '.join(arguments)})")

    def do_Assign(self, node: ast.Assign) -> None:
        target = node.targets[0]
        if isinstance(target, ast.Tuple):
            if not isinstance(node.value, ast.Tuple):
                self.refuse(node)
            assert isinstance(node.value, ast.Tuple)
            for part, value in zip(target.elts, [self.any(v) for v in node.value.elts], strict=True):
                self.store(part, value)
        else:
            self.store(target, self.any(node.value))

    def store(self, target: ast.expr, value: Value | Array) -> None:
        if isinstance(target, ast.Name):
            self.assign(target.id, value)
            return
        if not isinstance(target, ast.Subscript) or isinstance(value, Array):
            self.refuse(target)
        assert isinstance(target, ast.Subscript) and isinstance(value, Value)
        address, element = self.element(target)
        if element == "i8":
            value = self.emit(f"zext i1 {self.to(value, 'i1').text} to i8", "i8")
        elif element == "float":
            value = self.emit(f"fptrunc double {self.to(value, 'double').text} to float", "float")
        else:
            value = self.to(value, element)
        self.lines.append(f"  store {element} {value.text}, ptr {address}")

    def do_AugAssign(self, node: ast.AugAssign) -> None:
        self.store(node.target, self.binary(node.op, self.value(node.target), node.value))

    def do_Return(self, node: ast.Return) -> None:
        if node.value is not None:
            self.refuse(node)
        (after,) = self.labels("after")
        self.lines += ["  ret void", f"{after}:"]

    def do_Break(self, node: ast.Break) -> None:
        (after,) = self.labels("after")
        self.lines += [f"  br label %{self.targets[-1][1]}", f"{after}:"]

    def do_Continue(self, node: ast.Continue) -> None:
        (after,) = self.labels("after")
        self.lines += [f"  br label %{self.targets[-1][0]}", f"{after}:"]

    def do_If(self, node: ast.If) -> None:
        then, other, after = self.labels("then", "else", "endif")
        condition = self.to(self.value(node.test), "i1")
        self.lines += [f"  br i1 {condition.text}, label %{then}, label %{other}", f"{then}:"]
        self.block(node.body)
        self.lines += [f"  br label %{after}", f"{other}:"]
        self.block(node.orelse)
        self.label(after)

    def do_While(self, node: ast.While) -> None:
        test, body, after = self.labels("while", "do", "done")
        self.label(test)
        condition = self.to(self.value(node.test), "i1")
        self.lines += [f"  br i1 {condition.text}, label %{body}, label %{after}", f"{body}:"]
        self.targets.append((test, after))
        self.block(node.body)
        self.targets.pop()
        self.lines += [f"  br label %{test}", f"{after}:"]

    def do_For(self, node: ast.For) -> None:
        call, target = node.iter, node.target
        if not (isinstance(call, ast.Call) and ast.unparse(call.func) == "range" and isinstance(target, ast.Name)):
            self.refuse(node)
        assert isinstance(call, ast.Call) and isinstance(target, ast.Name)
        given = [self.to(self.value(part), "i64") for part in call.args]
        start, stop = (given[0], given[1]) if len(given) > 1 else (Value("0", "i64"), given[0])
        step = given[2] if len(given) > 2 else Value("1", "i64")
        test, body, more, after = self.labels("for", "do", "next", "done")
        counter = f"%counter.{test}"
        self.allocations.append(f"  {counter} = alloca i64")
        self.lines.append(f"  store i64 {start.text}, ptr {counter}")
        self.label(test)
        now = self.emit(f"load i64, ptr {counter}", "i64")
        relation = "sgt" if step.text.startswith("-") else "slt"
        condition = self.emit(f"icmp {relation} i64 {now.text}, {stop.text}", "i1")
        self.lines += [f"  br i1 {condition.text}, label %{body}, label %{after}", f"{body}:"]
        self.assign(target.id, now)
        self.targets.append((more, after))
        self.block(node.body)
        self.targets.pop()
        self.label(more)
        now = self.emit(f"load i64, ptr {counter}", "i64")
        later = self.emit(f"add nsw i64 {now.text}, {step.text}", "i64")
        self.lines += [f"  store i64 {later.text}, ptr {counter}", f"  br label %{test}", f"{after}:"]

    # ------------------------------------------------------------------------------------------------ expressions

    def any(self, node: ast.expr) -> Value | Array:
        """A number or a new array."""
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("np.zeros", "np.empty"):
            sizes = node.args[0].elts if isinstance(node.args[0], ast.Tuple) else [node.args[0]]
            shape = tuple(self.to(self.value(size), "i64") for size in sizes)
            total = shape[0]
            for size in shape[1:]:
                total = self.emit(f"mul nsw i64 {total.text}, {size.text}", "i64")
            address = self.emit(f"alloca double, i64 {total.text}, align 64", "ptr")
            if ast.unparse(node.func) == "np.zeros":
                size = self.emit(f"mul nsw i64 {total.text}, 8", "i64")
                self.lines.append(
                    f"  call void @llvm.memset.p0.i64(ptr {address.text}, i8 0, i64 {size.text}, i1 false)"
                )
            return Array(address.text, "double", shape)
        return self.value(node)

    def value(self, node: ast.expr) -> Value:
        found = getattr(self, f"of_{type(node).__name__}", self.refuse)(node)
        assert isinstance(found, Value)
        return found

    def constant(self, value: Any) -> Value:
        if isinstance(value, bool):
            return Value("true" if value else "false", "i1")
        return Value(str(value), "i64") if isinstance(value, int) else Value(number(float(value)), "double")

    def of_Constant(self, node: ast.Constant) -> Value:
        return self.constant(node.value)

    def of_Name(self, node: ast.Name) -> Value:
        place = self.locals.get(node.id)
        if place is None:
            return self.constant(self.outside[node.id])
        assert isinstance(place, Value), f"{node.id} is an array"
        return self.emit(f"load {place.type}, ptr {place.text}", place.type)

    def of_Attribute(self, node: ast.Attribute) -> Value:
        assert isinstance(node.value, ast.Name)
        return self.constant(getattr(self.outside[node.value.id], node.attr))

    def of_Subscript(self, node: ast.Subscript) -> Value:
        if (
            isinstance(node.value, ast.Attribute)
            and node.value.attr == "shape"
            and isinstance(node.slice, ast.Constant)
        ):
            assert isinstance(node.slice.value, int)
            return self.array(node.value.value).shape[node.slice.value]
        address, element = self.element(node)
        loaded = self.emit(f"load {element}, ptr {address}", element)
        if element == "float":
            return self.emit(f"fpext float {loaded.text} to double", "double")
        return self.to(loaded, "i1") if element == "i8" else loaded

    def of_UnaryOp(self, node: ast.UnaryOp) -> Value:
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return self.emit(f"xor i1 {self.to(value, 'i1').text}, true", "i1")
        if not isinstance(node.op, ast.USub):
            self.refuse(node)
        if value.type == "double":
            return self.emit(f"fneg double {value.text}", "double")
        if value.text.isdigit():
            return Value(f"-{value.text}", "i64")
        return self.emit(f"sub nsw i64 0, {value.text}", "i64")

    def of_BinOp(self, node: ast.BinOp) -> Value:
        return self.binary(node.op, self.value(node.left), node.right)

    def binary(self, operator: ast.operator, left: Value, right: ast.expr) -> Value:
        other = self.value(right)
        if isinstance(operator, ast.Pow):
            power = [self.to(value, "double").text for value in (left, other)]
            return self.emit(f"call double @llvm.pow.f64(double {power[0]}, double {power[1]})", "double")
        if isinstance(operator, ast.Div):
            a, b = (self.to(value, "double").text for value in (left, other))
            return self.emit(f"fdiv double {a}, {b}", "double")
        (a2, b2), kind = self.common(left, other)
        if isinstance(operator, ast.Mod | ast.FloorDiv) and kind == "i64":
            # Python's remainder has the sign of the divisor.
            rest = self.emit(f"srem i64 {a2.text}, {b2.text}", "i64")
            moved = self.emit(f"add i64 {rest.text}, {b2.text}", "i64")
            rest = self.emit(f"srem i64 {moved.text}, {b2.text}", "i64")
            if isinstance(operator, ast.Mod):
                return rest
            whole = self.emit(f"sub i64 {a2.text}, {rest.text}", "i64")
            return self.emit(f"sdiv i64 {whole.text}, {b2.text}", "i64")
        names = _ARITHMETIC[type(operator)]
        kind = "i64" if kind == "i1" else kind
        return self.emit(f"{names[kind == 'i64']} {kind} {self.to(a2, kind).text}, {self.to(b2, kind).text}", kind)

    def of_BoolOp(self, node: ast.BoolOp) -> Value:
        how = "and" if isinstance(node.op, ast.And) else "or"
        total, *rest = (self.to(self.value(part), "i1") for part in node.values)
        for value in rest:
            total = self.emit(f"{how} i1 {total.text}, {value.text}", "i1")
        return total

    def of_Compare(self, node: ast.Compare) -> Value:
        values = [self.value(part) for part in (node.left, *node.comparators)]
        found = []
        for operator, left, right in zip(node.ops, values, values[1:], strict=False):
            found.append(self.compare(_COMPARE[type(operator)], left, right))
        total = found[0]
        for value in found[1:]:
            total = self.emit(f"and i1 {total.text}, {value.text}", "i1")
        return total

    def compare(self, names: tuple[str, str], left: Value, right: Value) -> Value:
        (a, b), kind = self.common(left, right)
        if kind == "double":
            return self.emit(f"fcmp {names[0]} double {a.text}, {b.text}", "i1")
        return self.emit(f"icmp {names[1]} {kind} {a.text}, {b.text}", "i1")

    def of_IfExp(self, node: ast.IfExp) -> Value:
        condition = self.to(self.value(node.test), "i1")
        return self.select(condition, self.value(node.body), self.value(node.orelse))

    def select(self, condition: Value, one: Value, other: Value) -> Value:
        (a, b), kind = self.common(one, other)
        return self.emit(f"select i1 {condition.text}, {kind} {a.text}, {kind} {b.text}", kind)

    def of_Call(self, node: ast.Call) -> Value:
        name = ast.unparse(node.func).removeprefix("math.").removeprefix("np.")
        if name == "len":
            return self.array(node.args[0]).shape[0]
        values = [self.value(part) for part in node.args]
        if name in ("min", "max"):
            total = values[0]
            for value in values[1:]:  # as in Python: the first one, unless the next is smaller
                better = self.compare(_COMPARE[ast.Lt if name == "min" else ast.Gt], value, total)
                total = self.select(better, value, total)
            return total
        if name in ("int", "float"):
            return self.to(values[0], {"int": "i64", "float": "double"}[name])
        if name == "abs" and values[0].type == "i64":
            below = self.emit(f"icmp slt i64 {values[0].text}, 0", "i1")
            return self.select(below, self.emit(f"sub nsw i64 0, {values[0].text}", "i64"), values[0])
        one = self.to(values[0], "double").text
        if name == "isnan":
            return self.emit(f"fcmp uno double {one}, {one}", "i1")
        found = "llvm.fabs.f64" if name == "abs" else _OF_FLOATS.get(name)
        if found is None:
            self.refuse(node)
        return self.emit(f"call double @{found}(double {one})", "double")
