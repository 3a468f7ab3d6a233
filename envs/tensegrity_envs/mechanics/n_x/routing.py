"""Which cable spans which joints on which side: routings by name, and any matrix of them.

A routing is a table with a row for each cable and a column for each joint: -1 where the cable spans the left lateral
side of the joint, 1 where it spans the right one, 0 where it runs along struts, whose lengths are constant.
"""

from collections.abc import Sequence

import numpy as np

PER_JOINT, FROM_BASE = "per_joint", "from_base"
NAMES = (PER_JOINT, FROM_BASE)
Routing = tuple[tuple[int, ...], ...]


def checked_routing(given: str | Sequence[Sequence[int]], joints: int, owner: str) -> str | Routing:
    """A name as it is, a matrix as a tuple of rows of the integers -1, 0 and 1.

    Raises:
        TypeError: it is neither a name nor a table of integers.
        ValueError: there is no such name, or the table's shape or an entry is wrong; the message names it.
    """
    what = f"{owner}.routing = {given!r}"
    if isinstance(given, str):
        if given not in NAMES:
            raise ValueError(
                f"{what}: must be 'per_joint', 'from_base' or a matrix of -1, 0 and 1, a row for each cable"
            )
        return given
    try:
        rows = [list(row) for row in given]
    except TypeError:
        raise TypeError(f"{what}: must be 'per_joint', 'from_base' or a matrix, a row for each cable") from None
    if not rows:
        raise ValueError(f"{what}: must have one cable or more")
    for row in rows:
        if len(row) != joints:
            raise ValueError(f"{what}: each row must have {joints} entries, one for each joint, not {len(row)}")
        if not all(isinstance(entry, int | np.integer) and entry in (-1, 0, 1) for entry in row):
            raise ValueError(f"{what}: entries must be -1 (left side), 1 (right side) or 0 (not spanned), not {row}")
        if not any(row):
            raise ValueError(f"{what}: a cable must span one joint or more")
    return tuple(tuple(int(entry) for entry in row) for row in rows)


def routing_table(routing: str | Sequence[Sequence[int]], joints: int) -> Routing:
    """The table of a routing that `checked_routing` has passed.

    "per_joint" has the cables left 1, right 1, left 2, ...; "from_base" the same ones, each of which spans the joints
    below its own, too, on the same side.
    """
    if not isinstance(routing, str):
        return tuple(map(tuple, routing))
    rows = []
    for joint in range(joints):
        for side in (-1, 1):
            spanned = range(joint + 1) if routing == FROM_BASE else (joint,)
            rows.append(tuple(side if j in spanned else 0 for j in range(joints)))
    return tuple(rows)


def cable_names(routing: str | Sequence[Sequence[int]], table: Sequence[Sequence[int]]) -> tuple[str, ...]:
    """Names of the cables: "left 1", "right 1", ...; those of a matrix by number."""
    if isinstance(routing, str):
        return tuple(f"{side} {i // 2 + 1}" for i, side in enumerate(("left", "right") * (len(table) // 2)))
    return tuple(f"cable {i + 1}" for i in range(len(table)))
