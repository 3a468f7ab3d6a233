"""Loops over arrays that are written by hand, see `lowering`, as machine code."""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from tensegrity_envs.compiler import calling, machine, store
from tensegrity_envs.compiler.lowering import DECLARATIONS, DIMENSIONS, lower, parameters_of
from tensegrity_envs.compiler.numbers import hash_of

_TYPES = {
    "Vector": float,
    "Matrix": float,
    "Rows": float,
    "Table": np.float32,
    "Integers": np.int64,
    "Booleans": bool,
    "IntegerTable": np.int64,
    "BooleanTable": bool,
}


class Compiled:
    """A function of arrays that returns nothing, compiled when it is first called.

    Args:
        function: in the part of Python that `lowering` takes; it stays as `function`, which can be called as it is.
    """

    def __init__(self, function: Callable[..., None]) -> None:
        self.function = function

    @cached_property
    def _parameters(self) -> list[tuple[str, np.dtype[Any], int, str]]:
        kinds = parameters_of(self.function)
        return [(name, np.dtype(_TYPES[kind]), DIMENSIONS[kind], kind) for name, kind in kinds]

    def __call__(self, *arrays: np.ndarray) -> None:
        """Run it.

        Raises:
            TypeError: an array is not of the type that the function takes.
        """
        for array, (name, dtype, dimensions, kind) in zip(arrays, self._parameters, strict=True):
            fine = array.dtype == dtype and array.ndim == dimensions
            if not fine or not (array.flags.c_contiguous or (kind == "Rows" and array.strides[1] == array.itemsize)):
                raise TypeError(f"{name}: must be a C-contiguous array of {dtype} of {dimensions} dimensions")
        self.run(*arrays)

    @cached_property
    def run(self) -> Any:
        """The machine code, which trusts its caller that the arrays are what the function takes, and saves him the
        time that looking at each of them takes.
        """
        dimensions = [count for _, _, count, _ in self._parameters]
        gaps = [kind == "Rows" for _, _, _, kind in self._parameters]
        name = self.function.__name__
        lines = [DECLARATIONS, lower(self.function, "loops", {})]
        text = "\n".join(lines)
        entry = f"jit_{hash_of(text)}"
        source = "\n".join([text, *calling.entry_of_arrays(entry, "loops", dimensions, gaps)])
        key = f"{name.strip('_')}-{hash_of(text)}"
        code = store.fetch(key, machine.version(), lambda: machine.to_object(source, True))
        return calling.function(machine.load(code, entry), entry)
