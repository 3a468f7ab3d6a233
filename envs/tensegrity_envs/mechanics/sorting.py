"""The solutions of many targets in order, those of each target together."""

import numpy as np

from tensegrity_envs.compiler.jit import Compiled
from tensegrity_envs.compiler.lowering import Integers, Vector


def order_within(owner: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The index that sorts by owner, then by the first number, then by the second: `np.lexsort((second, first, owner))`
    where each owner has a few numbers only, in a tenth of its time.

    Args:
        owner: shape (m,), integers from 0 on.
        first: shape (m,); no NaN.
        second: shape (m,); no NaN.
    """
    order = np.empty(len(owner), np.int64)
    begin = np.zeros(int(owner.max()) + 2 if len(owner) else 1, np.int64)
    _order(np.ascontiguousarray(owner, np.int64), first, second, begin, np.zeros_like(begin), order)
    return order


@Compiled
def _order(owner: Integers, first: Vector, second: Vector, begin: Integers, placed: Integers, order: Integers) -> None:
    for k in range(len(owner)):
        begin[owner[k] + 1] += 1
    for i in range(1, len(begin)):
        begin[i] += begin[i - 1]
    for k in range(len(owner)):
        start = begin[owner[k]]
        place = start + placed[owner[k]]
        placed[owner[k]] += 1
        for at in range(place, start, -1):
            before = order[at - 1]
            if first[before] < first[k] or (first[before] == first[k] and second[before] <= second[k]):
                break
            order[at] = before
            place = at - 1
        order[place] = k
