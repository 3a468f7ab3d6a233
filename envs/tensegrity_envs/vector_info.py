"""The info of a vector environment: arrays by name, and masks that say of which environments they tell."""

from typing import Any

import numpy as np

from tensegrity_envs import columns
from tensegrity_envs.batch import InfoEntry


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
        self._vectors: list[tuple[str, slice]] = []
        rows = [entry.first for entry in kinds["float"]]
        for entry in entries:
            if entry.end is not None:
                self._vectors.append((entry.name, slice(len(rows), len(rows) + entry.end - entry.first)))
                rows.extend(range(entry.first, entry.end))
        self._scalars, sizes = slice(0, len(kinds["float"])), [len(rows), len(kinds["bool"]), len(kinds["int"]) + 1]
        rows += [entry.first for kind in ("bool", "int") for entry in kinds[kind]]
        self._rows, self._num_envs = np.array(rows, np.int64), num_envs
        scalars = [*(entry.name for of_kind in kinds.values() for entry in of_kind), "step"]
        masks = [f"_{name}" for name in (*scalars, *(name for name, _ in self._vectors))]
        self._names = [*scalars, *masks]
        self._shapes = [(size, num_envs) for size in (*sizes, len(masks), len(masks) + 1)]

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
        of_floats, of_truths, of_ints, of_masks, of_more_masks = self._shapes
        make = np.empty if index is None else np.zeros
        floats, truths, ints = make(of_floats), make(of_truths, bool), make(of_ints, np.int64)
        masks = make(of_masks if limits is None else of_more_masks, bool)  # each entry's own, to write into
        if index is None:
            columns.tell.run(self._rows, outcomes, steps, floats, truths, ints, masks)
        else:
            columns.tell_some.run(self._rows, outcomes, steps, index, floats, truths, ints, masks)
        info: dict[str, Any] = dict(zip(self._names, [*floats[self._scalars], *truths, *ints, *masks], strict=False))
        for name, part in self._vectors:
            info[name] = floats[part].T
        if limits is not None:
            info["time_limit"], info["_time_limit"] = limits, masks[-1]
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
