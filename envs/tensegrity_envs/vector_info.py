"""The info of a vector environment: arrays by name, and masks that say of which environments they tell."""

from typing import Any

import numpy as np

from tensegrity_envs.core import InfoEntry


class InfoTable:
    """Where the entries of `info` stand in a matrix of outcomes, grouped by kind: one operation for each group.

    Args:
        entries: of a core.
        num_envs: columns of the matrix.
    """

    def __init__(self, entries: list[InfoEntry], num_envs: int) -> None:
        kinds: dict[str, list[InfoEntry]] = {"float": [], "bool": [], "int": []}
        for entry in entries:
            if entry.end is None:
                kinds[entry.kind].append(entry)
        self._floats, self._truths, self._ints = ([entry.name for entry in of_kind] for of_kind in kinds.values())
        rows = [entry.first for of_kind in kinds.values() for entry in of_kind]
        self._vectors: list[tuple[str, int, int]] = []
        for entry in entries:
            if entry.end is not None:
                self._vectors.append((entry.name, len(rows), len(rows) + entry.end - entry.first))
                rows.extend(range(entry.first, entry.end))
        self._rows, self._num_envs = np.array(rows, int), num_envs
        names = [*self._floats, *self._truths, *self._ints, *(name for name, *_ in self._vectors), "step"]
        self._masks = [f"_{name}" for name in names]

    def told(
        self, outcomes: np.ndarray, steps: np.ndarray, mask: np.ndarray | None, limits: np.ndarray | None
    ) -> dict[str, Any]:
        """The info of all environments, or of those in the mask and zero for all others; nobody else's memory.

        Args:
            outcomes: the matrix.
            steps: since the episodes began, shape (num_envs,).
            mask: boolean, shape (num_envs,), or None for all.
            limits: of time, where they differ from environment to environment, else None.
        """
        if mask is None:
            values, steps = outcomes.take(self._rows, axis=0), steps.copy()
        else:
            index = np.flatnonzero(mask)
            values, here = np.zeros((len(self._rows), self._num_envs)), steps
            values[:, index] = outcomes[self._rows[:, None], index]
            steps = np.zeros_like(here)
            steps[index] = here[index]
        truths, ints = len(self._floats), len(self._floats) + len(self._truths)
        info: dict[str, Any] = dict(zip(self._floats, values, strict=False))
        info.update(zip(self._truths, values[truths:ints] != 0, strict=True))
        info.update(zip(self._ints, values[ints : ints + len(self._ints)].astype(np.int64), strict=True))
        for name, first, end in self._vectors:
            info[name] = values[first:end].T
        info["step"] = steps
        masks = np.empty((len(self._masks) + 1, self._num_envs), bool)  # each entry's own, to write into
        masks[:] = True if mask is None else mask
        if limits is not None:
            info["time_limit"], info["_time_limit"] = limits, masks[-1]
        info.update(zip(self._masks, masks, strict=False))
        return info
