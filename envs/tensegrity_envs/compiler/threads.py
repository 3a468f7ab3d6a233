"""Kernels on several processor cores: each thread evaluates some of the columns, which do not depend on one another.

What a column gives is the same to the last bit, whatever the number of threads. Compiled code of many columns lets
other threads of Python run meanwhile, see `calling`.
"""

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_envs.compiler.kernel import Kernel
from tensegrity_envs.compiler.loops import BLOCK
from tensegrity_envs.compiler.pytree import empty_matrix

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

_LEAST = 256  # columns that are worth a thread: handing them over takes as long as a hundred of a closed form


class Threads:
    """Some threads that evaluate kernels together.

    Args:
        count: of threads, the caller's included.

    Raises:
        ValueError: it is no whole number, or less than 1.
    """

    def __init__(self, count: int = 1) -> None:
        if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
            raise ValueError(f"threads = {count!r}: must be a whole number, at least 1")
        self.count = int(count)
        self._pool: ThreadPoolExecutor | None = None  # made on use

    def __getstate__(self) -> dict[str, Any]:
        """All but the threads, which belong to their process."""
        return {"count": self.count, "_pool": None}

    def __deepcopy__(self, memo: dict[int, Any]) -> "Threads":
        """As many threads of its own."""
        return Threads(self.count)

    def __call__(self, kernel: Kernel, *matrices: np.ndarray) -> np.ndarray:
        """What the kernel gives."""
        n = matrices[0].shape[1]
        parts = min(self.count, n // _LEAST)
        if parts < 2:
            return kernel(*matrices)
        if self._pool is None:
            from concurrent.futures import ThreadPoolExecutor  # only needed here

            self._pool = ThreadPoolExecutor(self.count - 1, thread_name_prefix="tensegrity")
        out = empty_matrix(kernel.result.size, n)
        edges = [n * k // parts // BLOCK * BLOCK for k in range(parts)] + [n]
        slices = [slice(start, stop) for start, stop in pairwise(edges)]
        others = [
            self._pool.submit(kernel.fill, out[:, part], *(matrix[:, part] for matrix in matrices))
            for part in slices[1:]
        ]
        try:
            kernel.fill(out[:, slices[0]], *(matrix[:, slices[0]] for matrix in matrices))
        finally:
            for other in others:
                other.result()
        return out

    def close(self) -> None:
        """End the threads; the next use begins new ones."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
