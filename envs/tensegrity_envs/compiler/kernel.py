"""Machine code from component code: traced once, written as loops, compiled by LLVM, kept on disk.

The first use of a function compiles it; its code is then kept in the user's cache directory, which
`TENSEGRITY_CACHE_DIR` moves, and later processes load it.
"""

import dataclasses
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from tensegrity_envs.compiler import calling, continuation, loops, lowering, machine, store, traces
from tensegrity_envs.compiler.loops import BLOCK, LANES
from tensegrity_envs.compiler.lowering import Matrix
from tensegrity_envs.compiler.numbers import hash_of
from tensegrity_envs.compiler.pytree import Schema, empty_matrix, is_array, tree_map
from tensegrity_envs.compiler.recent import Recent
from tensegrity_envs.compiler.tracing import Graph


class Kernel:
    """A function on pytrees of components, compiled for batches.

    Args:
        function: traceable: arithmetic and `namespace_of` functions on components, and `continuation`.
        schemas: of its arguments.

    Attributes:
        graph: the operations of which it consists, which kernels share that differ in numbers alone.
        result: schema of what the function returns.
    """

    def __init__(self, function: Callable[..., Any], *schemas: Schema[Any]) -> None:
        traced, constants = traces.traced(function, schemas)
        self.graph, self.result, self.schemas = traced.graph, traced.result, schemas
        self._first = traced.first
        self._size = self.result.size
        self._constants = np.array(constants or [0.0])
        self._load()

    def _load(self) -> None:
        """Find or make the machine code."""
        self._run, self._rows, self._free = _compiled(self.graph, self._first, self._size)

    @property
    def constants(self) -> dict[str, float]:
        """Its data that no argument holds, by source."""
        return dict(zip(self.graph.constants, self._constants.tolist(), strict=False))

    def __call__(self, *matrices: np.ndarray) -> np.ndarray:
        """Evaluate the function along the columns of matrices of shape (size, n), as a matrix.

        Rows that a matrix has beyond its schema's are not read.

        Raises:
            ValueError: a matrix has too few rows, or not as many columns as the others.
        """
        out = empty_matrix(self._size, matrices[0].shape[1])
        self.fill(out, *matrices)
        return out

    def fill(self, out: np.ndarray, *matrices: np.ndarray) -> None:
        """The same into a matrix that is there: from `empty_matrix`, or some columns of one."""
        work = self._free.pop() if self._free else np.empty(self._rows * BLOCK)
        if self._run(self._constants, work, out, *matrices) is not True:
            done = self._run(self._constants, work, out, *self._checked(matrices, out.shape[1]))
            if done is not True:  # never hand out what was not computed
                raise RuntimeError("compiled code refuses its arguments; please report this with the array's `flags`")
        self._free.append(work)

    def __deepcopy__(self, memo: dict[int, Any]) -> "Kernel":
        """Itself: nothing of it changes."""
        return self

    def __getstate__(self) -> dict[str, Any]:
        """All but the machine code, which another process finds on disk or makes anew from the graph."""
        return {name: value for name, value in vars(self).items() if name not in ("_run", "_rows", "_free")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """See `__getstate__`."""
        vars(self).update(state)
        self._constants = _own(self._constants)
        self._load()

    def source(self) -> str:
        """The module that is compiled, in LLVM's intermediate representation."""
        return _source(_Plan(self.graph, self._first, self.result.size), "kernel")

    def _checked(self, matrices: tuple[np.ndarray, ...], n: int) -> list[np.ndarray]:
        """The matrices as compiled code reads them."""
        for matrix, schema in zip(matrices, self.schemas, strict=True):
            if matrix.ndim != 2 or matrix.shape[0] < schema.size or matrix.shape[1] != n:
                raise ValueError(f"a matrix of shape {matrix.shape}: must be ({schema.size}, {n})")
        return [_own(matrix) for matrix in matrices]


def _own(array: np.ndarray) -> np.ndarray:
    """A copy of NumPy's own dtype: that of an array that was pickled is equal to it, but another object, and so is that
    of all that is computed from such an array.
    """
    own = empty_matrix(*array.shape) if array.ndim == 2 else np.empty(array.shape)
    own[...] = array
    return own


_LOADED: dict[str, Any] = {}


def _compiled(graph: Graph, first: list[int], results: int) -> tuple[Any, int, list[np.ndarray]]:
    """The compiled function of constants, working memory, results and matrices, see `calling`; how many rows of working
    memory it needs; and such memory that no thread uses now.
    """
    key = hash_of(f"{_signature(graph)}\n{first} {results}")
    if key not in _LOADED:
        plan = _Plan(graph, first, results)
        code = store.fetch(key, machine.version(), lambda: machine.to_object(_source(plan, f"kernel_{key}")))
        _LOADED[key] = calling.function(machine.load(code, f"kernel_{key}"), f"kernel_{key}"), plan.rows, []
    found: tuple[Any, int, list[np.ndarray]] = _LOADED[key]
    return found


def _signature(graph: Graph) -> str:
    """A text that two functions of the same code share, and no others."""
    parts = [repr([tuple(op) for op in graph.ops]), repr([tuple(i) for i in graph.inputs.items()]), repr(graph.stores)]
    for path in graph.paths:
        parts += [f"path {path.rows.parameter} {path.level} {path.resolution}", _signature(path.graph)]
    return "\n".join(parts)


class _Plan:
    """The loops of a function, and which rows of the working memory they use: its own, then those of its paths."""

    def __init__(self, graph: Graph, first: list[int], results: int) -> None:
        self.graph, self.first, self.results = graph, first, results
        self.bodies, self.own = loops.loops(graph, first[-1] + results)
        self.newtons, self.needed = [], []
        for path in graph.paths:
            inner, rows = loops.loops(path.graph, path.rows.captured + len(path.graph.captured))
            (body,) = inner.values()
            self.newtons.append(body)
            self.needed.append(rows)
        self.rows = self.own + 2 * sum(self.needed) + 1


def _source(plan: _Plan, name: str) -> str:
    """The module of a function, whose rows and the results' begin at the rows `first` of its own matrix.

    Some columns at a time are read, worked on and written: the rows of a matrix with a power of two of columns compete
    for the same few places of the processor's cache.
    """
    graph, first = plan.graph, plan.first
    lines = [lowering.DECLARATIONS, loops.functions()]
    lines += [lowering.lower(move_in, "move_in", {}), lowering.lower(move_out, "move_out", {})]
    known: dict[tuple[int, str], int] = {}
    of_path = []
    for k, (path, body) in enumerate(zip(graph.paths, plan.newtons, strict=True)):
        identity = path.rows.parameter, "\n".join(body)
        if identity not in known:
            known[identity] = k
            lines += _newton(f"newton_{k}", body)
            lines += _follower(k, path.rows.parameter)
        of_path.append(known[identity])
    arrays = ["w", *(f"w{k}" for k in range(len(graph.paths)))]
    for level, body in plan.bodies.items():
        lines += _loop(f"level_{level}", body, [f"ptr noalias %{array}" for array in arrays])
    inputs = [f"i{k}" for k in range(len(first) - 1)]
    matrices = ", ".join(f"ptr noalias %{name}, i64 %row.{name}" for name in ("out", *inputs))
    given = ["ptr noalias %c", "i64 %n", "ptr noalias %w", matrices]
    lines += [f"define internal void @columns({', '.join(given)}) {{", "entry:"]
    row = plan.own
    for k, size in enumerate(plan.needed):
        lines += [f"  %w{k} = getelementptr double, ptr %w, i64 {row * BLOCK}"]
        lines += [f"  %alone{k} = getelementptr double, ptr %w, i64 {(row + size) * BLOCK}"]
        row += 2 * size
    lines += ["  br label %block", "block:", "  %start = phi i64 [0, %entry], [%next, %block]"]
    lines += ["  %left = sub i64 %n, %start", "  %some = icmp slt i64 %left, 16"]
    lines += [f"  %count = select i1 %some, i64 %left, i64 {BLOCK}"]
    for i, (start, after) in zip(inputs, pairwise(first), strict=True):
        size = after - start
        arguments = f"i64 {size}, i64 %count, ptr %{i}, i64 {size}, i64 %row.{i}, i64 %start"
        lines += [f"  call void @move_in({arguments}, ptr %w, i64 {plan.own}, i64 {BLOCK}, i64 {start})"]
    passed = ", ".join(f"ptr %{array}" for array in arrays)
    for level in sorted({*plan.bodies, *(path.level for path in graph.paths)}):
        for k, path in enumerate(graph.paths):
            if path.level == level:
                lines += _follow(k, of_path[k], path.resolution, plan.needed[k])
        if level in plan.bodies:
            lines += [f"  call void @level_{level}(ptr %c, i64 %count, {passed})"]
    size = plan.results
    arguments = f"i64 {size}, i64 %count, ptr %w, i64 {plan.own}, i64 {BLOCK}, i64 {first[-1]}"
    lines += [f"  call void @move_out({arguments}, ptr %out, i64 {size}, i64 %row.out, i64 %start)"]
    lines += [f"  %next = add i64 %start, {BLOCK}", "  %more = icmp slt i64 %next, %n"]
    lines += ["  br i1 %more, label %block, label %done", "done:", "  ret void", "}"]
    lines += calling.entry(name, [after - start for start, after in pairwise(first)])
    return "\n".join(lines) + "\n"


def _loop(name: str, body: list[str], arrays: list[str]) -> list[str]:
    """A function that runs a loop's body for all columns."""
    head = f"define internal void @{name}(ptr noalias %c, i64 %count, {', '.join(arrays)}) {{"
    return [
        head,
        "entry:",
        "  br label %loop",
        "loop:",
        "  %g = phi i64 [0, %entry], [%next, %loop]",
        *body,
        f"  %next = add i64 %g, {LANES}",
        "  %more = icmp slt i64 %next, %count",
        "  br i1 %more, label %loop, label %done",
        "done:",
        "  ret void",
        "}",
    ]


def _newton(name: str, body: list[str]) -> list[str]:
    """A function that `continuation` calls: its constants and its matrix come with their shapes."""
    given = "ptr noalias %c, i64 %sizes, ptr noalias %w, i64 %rows, i64 %columns, i64 %count"
    return [f"define internal void @{name}({given}) {{", *_loop(name, body, [])[1:]]


def _follower(k: int, n: int) -> list[str]:
    """The functions of `continuation` for the Newton step number k, of n coordinates."""
    found: list[Callable[..., Any]] = []

    def newton(c: lowering.Vector, w: Matrix, count: int) -> None:
        """Stands for the one in LLVM."""

    def collect(function: Callable[..., Any]) -> Callable[..., Any]:
        found.append(function)
        return function

    continuation.follower(newton, n, collect)
    names = {"newton": f"newton_{k}", **{f.__name__: f"{f.__name__}_{k}" for f in found}}
    return [lowering.lower(f, names[f.__name__], names) for f in found]


def _follow(k: int, same: int, resolution: str, rows: int) -> list[str]:
    lines = []
    if resolution[0] == "c":
        lines = [f"  %ra{k} = getelementptr double, ptr %c, i64 {resolution[1:]}"]
        lines += [f"  %r{k} = load double, ptr %ra{k}"]
        resolution = f"%r{k}"
    else:
        resolution = lowering.number(float(resolution))
    matrix = f"i64 {rows}, i64 {BLOCK}"
    arguments = f"ptr %c, i64 0, ptr %w{k}, {matrix}, ptr %alone{k}, {matrix}, i64 %count, double {resolution}"
    return [*lines, f"  call void @follow_{same}({arguments})"]


def move_in(rows: int, count: int, source: Matrix, start: int, w: Matrix, first: int) -> None:
    """Some columns of a matrix into the working memory; the last one again, up to a whole number of lanes."""
    for r in range(rows):
        for n in range(count):
            w[first + r, n] = source[r, start + n]
        for n in range(count, (count + LANES - 1) // LANES * LANES):
            w[first + r, n] = source[r, start + count - 1]


def move_out(rows: int, count: int, w: Matrix, first: int, target: Matrix, start: int) -> None:
    """The results from the working memory."""
    for r in range(rows):
        for n in range(count):
            target[r, start + n] = w[first + r, n]


def evaluate(function: Callable[..., Any], *arguments: Any) -> Any:
    """Evaluate a traceable function on pytrees of floats and arrays that broadcast against one another.

    Compiled code for arrays and floats alike; floats in, floats out. Integers, strings, functions and the numbers of
    designs that are no arrays are part of the kernel, not data.
    """
    parts: list[list[Any]] = [[] for _ in arguments]
    key: list[Any] = [function]
    for argument, leaves in zip(arguments, parts, strict=True):
        _flatten(argument, leaves, key)
    shapes = {leaf.shape for leaves in parts for leaf in leaves if isinstance(leaf, np.ndarray)}
    shape = shapes.pop() if len(shapes) == 1 else np.broadcast_shapes((), *shapes)
    if len(shape) > 1:
        raise ValueError(f"components of shape {shape}: must be floats or arrays of shape (n,)")
    kernel = _OF_FUNCTION.get(known := tuple(key))
    if kernel is None:
        kernel = Kernel(function, *_schemas(arguments))
        _OF_FUNCTION.put(known, kernel)
    count = shape[0] if shape else 1
    matrices = []
    for leaves in parts:
        matrices.append(empty_matrix(len(leaves), count))
        for row, leaf in zip(matrices[-1], leaves, strict=True):
            row[:] = leaf
    found = kernel(*matrices)
    return kernel.result.unpack(found if shape else found[:, 0])


_OF_FUNCTION: Recent[Any, Kernel] = Recent(128)  # among whose keys are designs


def _flatten(tree: object, leaves: list[Any], key: list[Any]) -> None:
    """Collect the components of a pytree, and what tells it from pytrees of which another kernel is made."""
    kind = type(tree)
    if kind is float or isinstance(tree, float | np.ndarray):
        leaves.append(tree)
        key.append(float)
    elif isinstance(tree, tuple | list | dict):
        key += [kind, tuple(tree) if kind is dict else len(tree)]
        for part in tree.values() if isinstance(tree, dict) else tree:
            _flatten(part, leaves, key)
    elif not dataclasses.is_dataclass(tree):
        key += [kind, tree]
    else:
        try:
            hash(tree)
        except TypeError:  # it has arrays
            key.append(kind)
            for part in vars(tree).values():
                _flatten_design(part, leaves, key)
        else:
            key += [kind, tree]


def _flatten_design(tree: object, leaves: list[Any], key: list[Any]) -> None:
    """The same of a part of a design, of which only arrays are components."""
    if isinstance(tree, np.ndarray):
        leaves.append(tree)
        key.append(float)
    elif isinstance(tree, tuple | list | dict):
        key += [type(tree), tuple(tree) if isinstance(tree, dict) else len(tree)]
        for part in tree.values() if isinstance(tree, dict) else tree:
            _flatten_design(part, leaves, key)
    elif dataclasses.is_dataclass(tree):
        key.append(type(tree))
        for part in vars(tree).values():
            _flatten_design(part, leaves, key)
    else:
        key += [type(tree), tree]


def _schemas(arguments: Any) -> list[Schema[Any]]:
    """Of the arguments of `evaluate`."""

    def vary(tree: object) -> Any:
        return tree_map(vary, tree, is_array) if dataclasses.is_dataclass(tree) else np.zeros(1)

    whole = tree_map(
        vary, arguments, lambda tree: isinstance(tree, float | np.ndarray) or dataclasses.is_dataclass(tree)
    )
    return [Schema(argument, kind=lambda _: "float") for argument in whole]
