"""The info of a vector environment: arrays by name, and masks that say of which environments they tell."""

from typing import Any

import numpy as np

from tensegrity_envs import columns
from tensegrity_envs.core import InfoEntry


class InfoTable:
    """Where the entries of `info` stand in a matrix of outcomes, grouped by kind: one block of memory for each kind.

    Entries are rows of these blocks, which are made anew for every info.

    Args:
        entries: of a core.
        num_envs: columns of the matrix.
    """

    def __init__(self, entries: list[InfoEntry], num_envs: int) -> None:
        kinds: dict[str, list[InfoEntry]] = {"float": [], "bool": [], "int": []}
        for entry in entries:
            if entry.end is None:
                kinds[entry.kind].append(entry)
        floats, self._truths, ints = ([entry.name for entry in of_kind] for of_kind in kinds.values())
        self._floats, self._ints = floats, [*ints, "step"]
        rows = [entry.first for entry in kinds["float"]]
        self._vectors: list[tuple[str, int, int]] = []
        for entry in entries:
            if entry.end is not None:
                self._vectors.append((entry.name, len(rows), len(rows) + entry.end - entry.first))
                rows.extend(range(entry.first, entry.end))
        self._float_rows = len(rows)
        rows += [entry.first for of_kind in ("bool", "int") for entry in kinds[of_kind]]
        self._rows, self._num_envs = np.array(rows, np.int64), num_envs
        names = [*self._floats, *self._truths, *self._ints, *(name for name, *_ in self._vectors)]
        self._masks = [f"_{name}" for name in names]

    def told(
        self, outcomes: np.ndarray, steps: np.ndarray, index: np.ndarray | None, limits: np.ndarray | None
    ) -> dict[str, Any]:
        """The info of all environments, or of those at `index` and zero for all others; nobody else's memory.

        Args:
            outcomes: the matrix.
            steps: since the episodes began, shape (num_envs,).
            index: of some environments, or None for all.
            limits: of time, where they differ from environment to environment, else None; the info keeps it.
        """
        n, make = self._num_envs, np.empty if index is None else np.zeros
        floats, ints = make((self._float_rows, n)), make((len(self._ints), n), np.int64)
        truths = make((len(self._truths), n), bool)
        masks = make((len(self._masks) + (limits is not None), n), bool)  # each entry's own, to write into
        if index is None:
            columns.tell.run(self._rows, outcomes, steps, floats, truths, ints, masks)
        else:
            columns.tell_some.run(self._rows, outcomes, steps, index, floats, truths, ints, masks)
        info: dict[str, Any] = dict(zip(self._floats, floats, strict=False))
        info.update(zip(self._truths, truths, strict=True))
        info.update(zip(self._ints, ints, strict=True))
        for name, first, end in self._vectors:
            info[name] = floats[first:end].T
        info.update(zip(self._masks, masks, strict=False))
        if limits is not None:
            info["time_limit"], info["_time_limit"] = limits, masks[-1]
        return info
