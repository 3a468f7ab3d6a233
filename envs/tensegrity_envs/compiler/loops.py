"""The operations of a traced function as loops over the columns of a matrix, of which compilers make vector code.

One instruction does the arithmetic of several columns; a call, such as an arc tangent, is made for one at a time. So
calls have loops of their own: first comes the arithmetic that needs none, then the calls that need only that, then the
arithmetic that needs these calls, and so on.
"""

import re
from collections import defaultdict

from tensegrity_envs.compiler.tracing import Graph, Input, Slot


def loops(graph: Graph, first: int, width: int) -> tuple[list[str], int]:
    """Lines of code of a function on the matrix `w`, whose rows of `width` numbers follow one another.

    In all loops `n` is the column and `count` the number of columns; `c` are the constants.

    Args:
        graph: of the function.
        first: row from which on the function may keep values between its loops.
        width: of a row.

    Returns:
        The lines, and how many rows there must be.
    """
    ops = {op.name: op for op in graph.ops}
    loop_of = {op.name: _loop(op.level, op.is_call) for op in graph.ops}
    slots = defaultdict(list)  # at which to leave a value, by its name
    for slot, name in graph.stores:
        slots[name].append(slot)
    inputs = dict(graph.inputs)
    row = first
    for op in graph.ops:
        for name in op.arguments:
            if name not in inputs and loop_of[name] != loop_of[op.name]:
                inputs[name] = Input(Slot("w", row), ops[name].level, ops[name].kind)
                slots[name].append(inputs[name].slot)
                row += 1

    body: dict[int, list[str]] = defaultdict(list)
    known: dict[int, set[str]] = defaultdict(set)

    def element(slot: Slot) -> str:
        return f"{slot.array}[{slot.row * width} + n]"

    def read(name: str, loop: int) -> None:
        if name in inputs and name not in known[loop]:
            is_true = " != 0" if inputs[name].kind == "bool" else ""
            body[loop].append(f"{name} = {element(inputs[name].slot)}{is_true}")
            known[loop].add(name)

    def write(name: str, loop: int) -> None:
        body[loop].extend(f"{element(slot)} = {name}" for slot in slots.pop(name, []))

    for op in graph.ops:
        loop = loop_of[op.name]
        for name in op.arguments:
            read(name, loop)
        body[loop].append(f"{op.name} = {op.expression}")
        known[loop].add(op.name)
        write(op.name, loop)
    for name in list(slots):  # inputs and constants
        loop = _loop(inputs[name].level if name in inputs else 0, False)
        read(name, loop)
        write(name, loop)

    code = []
    for loop in sorted({*body, *(_loop(path.level, True) for path in graph.paths)}):
        for k, path in enumerate(graph.paths):
            if loop == _loop(path.level, True):
                code.append(f"follow_{k}(c, m{k}, alone{k}, count, {path.resolution})")
        if body[loop]:
            code += ["for n in range(count):", *(f"    {line}" for line in body[loop])]
    used = sorted({int(number) for line in code for number in re.findall(r"\bc(\d+)\b", line)})
    return [*(f"c{k} = c[{k}]" for k in used), *code], row


def _loop(level: int, is_call: bool) -> int:
    """Its number: the calls of a level come before its arithmetic."""
    return 2 * level + (not is_call)
