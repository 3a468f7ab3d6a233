"""Component code as JavaScript: the operations of a traced function, written out as one function of numbers.

A page in a browser so runs the equations that Python runs. What a component function may do, the package's page says;
paths of equilibria (`continuation`) are not written in JavaScript.
"""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from tensegrity_envs.compiler.pytree import Row, Schema, is_row, tree_map
from tensegrity_envs.compiler.tracing import Graph, Op, Slot, Symbol

_INFIX = {
    "add": "+", "sub": "-", "mul": "*", "truediv": "/",
    "lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "===", "ne": "!==",
    "and": "&&", "or": "||",
}  # fmt: skip
_CALLS = {
    "sine": "Math.sin", "cosine": "Math.cos", "sqrt": "Math.sqrt", "atan2": "Math.atan2", "abs": "Math.abs",
    "min": "Math.min", "max": "Math.max", "pow": "Math.pow", "log": "Math.log", "isfinite": "Number.isFinite",
    "single": "Math.fround",
}  # fmt: skip


def function(name: str, component_code: Callable[..., Any], **arguments: Any) -> str:
    """The source of a JavaScript function that does what component code does.

    Its arguments and its result are pytrees as in Python: tuples are arrays, named tuples, designs and dicts are
    objects with the names of their fields. Numbers are double, as in Python; the sine, cosine and arc tangent are those
    of the browser, which may differ in the last bit.

    Args:
        name: of the function.
        component_code: traceable.
        arguments: by name, in the order of the parameters: pytrees whose arrays tell what varies, as for `Schema`;
            everything else is written into the function.

    Returns:
        The declaration, `function name(...) {...}`.

    Raises:
        ValueError: a name is not one of JavaScript's, or the code follows a path of equilibria.
    """
    for word in (name, *arguments):
        if not re.fullmatch(r"[A-Za-z_]\w*", word):
            raise ValueError(f"{word!r}: must be a name in JavaScript, of letters, digits and underscores")
    graph = Graph()
    written: dict[str, str] = {}  # how a value is written, by the name of its symbol

    def symbols(argument: str, tree: object) -> Any:
        schema = Schema(tree)
        places = _places(schema.rows, argument)

        def symbol(row: Row) -> Symbol:
            found = graph.input(Slot(argument, row), row.kind)
            written[found.name] = places[row]
            return found

        return tree_map(symbol, schema.rows, is_row)

    result = component_code(*(symbols(argument, tree) for argument, tree in arguments.items()))
    if graph.paths:
        raise ValueError(f"{name}: it follows a path of equilibria, which is not written in JavaScript")
    leaves: list[str] = []

    def shown(value: object) -> str:
        leaves.append(str(graph.local(value)))
        return leaves[-1]

    answer = _literal(result, shown)
    lines = []
    for op in _needed(graph, set(leaves)):
        lines.append(f"  const {op.name} = {_expression(op, written)};")
    text = re.sub(r"§([^§]*)§", lambda match: _word(match.group(1), written), answer)
    return "\n".join([f"function {name}({', '.join(arguments)}) {{", *lines, f"  return {text};", "}"])


def _places(rows: object, prefix: str) -> dict[int, str]:
    """Where the components of an argument stand in it, in JavaScript, by their row."""
    found: dict[int, str] = {}

    def visit(tree: object, place: str) -> None:
        if isinstance(tree, Row):
            found[tree] = place
        elif fields := _fields(tree):
            for key, part in fields.items():
                visit(part, f"{place}.{key}")
        elif isinstance(tree, tuple | list):
            for k, part in enumerate(tree):
                visit(part, f"{place}[{k}]")

    visit(rows, prefix)
    return found


def _fields(tree: object) -> dict[str, Any]:
    """What becomes an object, by name."""
    if hasattr(tree, "_asdict"):
        return dict(tree._asdict())
    if isinstance(tree, dict):
        return tree
    return vars(tree) if hasattr(type(tree), "__dataclass_fields__") else {}


def _literal(tree: object, shown: Callable[[Any], str]) -> str:
    """A result as an array, an object or a number."""
    if fields := _fields(tree):
        return "{" + ", ".join(f"{key}: {_literal(part, shown)}" for key, part in fields.items()) + "}"
    if isinstance(tree, tuple | list):
        return "[" + ", ".join(_literal(part, shown) for part in tree) + "]"
    return f"§{shown(tree.item() if isinstance(tree, np.generic) else tree)}§"


def _needed(graph: Graph, wanted: set[str]) -> list[Op]:
    """The operations on which results depend, in their order."""
    kept = []
    for op in reversed(graph.ops):
        if op.name in wanted:
            kept.append(op)
            wanted.update(op.arguments)
    return kept[::-1]


def _word(name: str, written: dict[str, str]) -> str:
    """A symbol or a number of a graph, in JavaScript."""
    if name in written:
        return written[name]
    if name in ("True", "False"):
        return name.lower()
    if re.fullmatch(r"v\d+", name):
        return name
    value = float(name)
    if math.isfinite(value):
        return f"({name})" if name.startswith("-") else name
    return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "(-Infinity)"


def _expression(op: Op, written: dict[str, str]) -> str:
    a, b, c = ([_word(argument, written) for argument in op.arguments] + ["", ""])[:3]
    if op.code in _INFIX:
        return f"{a} {_INFIX[op.code]} {b}"
    if op.code in _CALLS:
        return f"{_CALLS[op.code]}({', '.join(_word(argument, written) for argument in op.arguments)})"
    if op.code == "where":
        return f"{a} ? {b} : {c}"
    if op.code == "neg":
        return f"-{a}"
    if op.code == "not":
        return f"!{a}"
    if op.code == "hypot":  # as machine code has it; JavaScript's own is many times slower
        return f"Math.sqrt({a} * {a} + {b} * {b})"
    if op.code == "copysign":
        return f"{b} < 0 || Object.is({b}, -0) ? -Math.abs({a}) : Math.abs({a})"
    raise ValueError(f"no JavaScript for the operation {op.code!r}")
