"""Loops over arrays that are written by hand, see `lowering`, as machine code."""

from collections.abc import Callable
from typing import Any

import numpy as np

from tensegrity_envs.compiler import calling, machine, store
from tensegrity_envs.compiler.lowering import DECLARATIONS, DIMENSIONS, lower, parameters_of
from tensegrity_envs.compiler.numbers import hash_of

_TYPES = {"Vector": float, "Matrix": float, "Table": np.float32, "Integers": np.int64, "Booleans": bool}


class Compiled:
    """A function of C-contiguous arrays that returns nothing, compiled when it is first called.

    Args:
        function: in the part of Python that `lowering` takes; it stays as `function`, which can be called as it is.
    """

    def __init__(self, function: Callable[..., None]) -> None:
        self.function = function
        self._parameters = [(name, np.dtype(_TYPES[kind]), DIMENSIONS[kind]) for name, kind in parameters_of(function)]
        self._run: Any = None

    def __call__(self, *arrays: np.ndarray) -> None:
        """Run it.

        Raises:
            TypeError: an array is not of the type that the function takes.
        """
        for array, (name, dtype, dimensions) in zip(arrays, self._parameters, strict=True):
            if array.dtype != dtype or array.ndim != dimensions or not array.flags.c_contiguous:
                raise TypeError(f"{name}: must be a C-contiguous array of {dtype} of {dimensions} dimensions")
        if self._run is None:
            self._run = self._compiled()
        self._run(*arrays)

    def _compiled(self) -> Any:
        dimensions = [count for _, _, count in self._parameters]
        name = self.function.__name__
        lines = [DECLARATIONS, lower(self.function, "loops", {})]
        text = "\n".join(lines)
        entry = f"jit_{hash_of(text)}"
        source = "\n".join([text, *calling.entry_of_arrays(entry, "loops", dimensions)])
        code = store.fetch(f"{name.strip('_')}-{hash_of(text)}", machine.version(), lambda: machine.to_object(source))
        return calling.function(machine.load(code, entry), entry)
