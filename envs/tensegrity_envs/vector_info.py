"""The info of a vector environment: arrays by name, and masks that say of which environments they tell."""

from typing import Any

import numpy as np

from tensegrity_envs import columns
from tensegrity_envs.batch import InfoEntry


class InfoTable:
    """Where the entries of `info` stand in a matrix of outcomes, grouped by kind: one block of memory for each kind.

    Entries are rows of these blocks, which are made anew for every info. Their masks, which are all alike, are one
    array that cannot be written to: making forty arrays more would take as long as the physics of 64 environments.

    Args:
        entries: of a core.
        num_envs: columns of the matrix.
        limit: of time, if the info is to tell every environment's own, else None.
    """

    def __init__(self, entries: list[InfoEntry], num_envs: int, limit: int | None) -> None:
        kinds: dict[str, list[InfoEntry]] = {"float": [], "bool": [], "int": []}
        for entry in entries:
            if entry.end is None:
                kinds[entry.kind].append(entry)
        self._vectors: list[tuple[str, slice]] = []
        rows = [entry.first for entry in kinds["float"]]
        for entry in entries:
            if entry.end is not None:
                self._vectors.append((entry.name, slice(len(rows), len(rows) + entry.end - entry.first)))
                rows.extend(range(entry.first, entry.end))
        counted = ["step"] if limit is None else ["step", "time_limit"]
        sizes = [len(rows), len(kinds["bool"]), len(kinds["int"]) + len(counted)]
        rows += [entry.first for kind in ("bool", "int") for entry in kinds[kind]]
        self._rows = np.array([*rows, limit or 0], np.int64)
        self._scalars = slice(0, len(kinds["float"]))
        self._shapes = [(size, num_envs) for size in sizes]
        self._names = [*(entry.name for of_kind in kinds.values() for entry in of_kind), *counted]
        masks = [f"_{name}" for name in (*self._names, *dict(self._vectors))]
        self._masks, self.limit = dict.fromkeys(masks, np.ones(num_envs, bool)), limit
        self._protect()

    def _protect(self) -> None:
        for mask in self._masks.values():
            mask.flags.writeable = False

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Of a copy, whose arrays can be written to."""
        vars(self).update(state)
        self._protect()

    def told(
        self, outcomes: np.ndarray, steps: np.ndarray, ahead_of_time: np.ndarray, index: np.ndarray | None
    ) -> dict[str, Any]:
        """The info of all environments, or of those at `index` and zero for all others; nobody else's memory.

        Args:
            outcomes: the matrix.
            steps: since the episodes began, shape (num_envs,).
            ahead_of_time: by how many steps the time limits come earlier, likewise.
            index: of some environments, or None for all.
        """
        of_floats, of_truths, of_ints = self._shapes
        if index is None:
            floats, truths, ints = np.empty(of_floats), np.empty(of_truths, bool), np.empty(of_ints, np.int64)
            columns.info_entries.run(self._rows, outcomes, steps, ahead_of_time, floats, truths, ints)
            info: dict[str, Any] = self._masks.copy()
        else:
            floats, truths, ints = np.zeros(of_floats), np.zeros(of_truths, bool), np.zeros(of_ints, np.int64)
            mask = np.zeros(of_floats[1], bool)
            columns.some_info_entries.run(self._rows, outcomes, steps, ahead_of_time, index, floats, truths, ints, mask)
            mask.flags.writeable = False
            info = dict.fromkeys(self._masks, mask)
        info.update(zip(self._names, [*floats[self._scalars], *truths, *ints], strict=True))
        for name, part in self._vectors:
            info[name] = floats[part].T
        return info


def step_info(info: dict[str, Any]) -> dict[str, Any]:
    """The info of the step itself, whatever the autoreset mode: where episodes ended in it, what final_info tells.

    In the mode SAME_STEP, the vector environments' `info` tells of the next episode where one has ended.

    Args:
        info: that `step` of a vector environment returned.

    Returns:
        The entries as arrays of shape (num_envs, ...), without masks.
    """
    told = {name: value for name, value in info.items() if not name.startswith(("_", "final_"))}
    if "final_info" not in info:
        return told
    ended = info["_final_info"]
    last = info["final_info"]
    return {
        name: np.where(ended.reshape(-1, *[1] * (np.ndim(value) - 1)), last[name], value)
        for name, value in told.items()
    }
