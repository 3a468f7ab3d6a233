"""What the vector shell does with the columns of its matrices, as compiled loops: see `compiler.lowering`.

NumPy would take one call, and one array more, for each of these steps; of 1,024 environments that took as long as the
physics, of 64 ten times as long.
"""

import math

from tensegrity_envs.compiler.jit import Compiled
from tensegrity_envs.compiler.lowering import (
    Booleans,
    BooleanTable,
    Integers,
    IntegerTable,
    Matrix,
    Rows,
    Table,
    Vector,
)

BLOCK = 32  # environments whose numbers are moved from rows to rows of their own while they are in the cache


@Compiled
def actions_of_singles(given: Table, skipped: Booleans, columns: Rows, wrong: Integers) -> None:
    """Actions, shape (n, size), as columns, clipped to [-1, 1]; those of the skipped environments are 0.

    Leaves in `wrong` the first environment whose action is not finite, or n.
    """
    n, size = given.shape[0], given.shape[1]
    wrong[0] = n
    for j in range(n - 1, -1, -1):
        for i in range(size):
            value = float(given[j, i])
            if not skipped[j] and not abs(value) < math.inf:
                wrong[0] = j
            columns[i, j] = 0.0 if skipped[j] else min(max(value, -1.0), 1.0)


@Compiled
def actions_of_doubles(given: Matrix, skipped: Booleans, columns: Rows, wrong: Integers) -> None:
    """The same for actions in double precision."""
    n, size = given.shape[0], given.shape[1]
    wrong[0] = n
    for j in range(n - 1, -1, -1):
        for i in range(size):
            value = given[j, i]
            if not skipped[j] and not abs(value) < math.inf:
                wrong[0] = j
            columns[i, j] = 0.0 if skipped[j] else min(max(value, -1.0), 1.0)


@Compiled
def ends(
    rows: Integers,
    outcomes: Rows,
    skipped: Booleans,
    steps: Integers,
    ahead_of_time: Integers,
    reward: Vector,
    flags: BooleanTable,
    ended: Booleans,
    index: Integers,
) -> None:
    """Count the step that led to these outcomes, and tell reward and flags.

    Args:
        rows: of reward and failure in the outcomes; the time limit, or a negative number for none.
        outcomes: a column for each environment.
        skipped: environments that have begun an episode instead; overwritten only if it is `ended`, too.
        steps: since the episodes began, brought up to date.
        ahead_of_time: by how many steps their time limits come earlier.
        reward: to be filled.
        flags: terminated, truncated; to be filled.
        ended: whether either; to be filled.
        index: of those that ended, followed by how many they are in the last place; of n + 1.
    """
    n, limit, count = len(reward), rows[2], 0
    for j in range(n):  # one array after another, several environments in an instruction
        steps[j] = 0 if skipped[j] else steps[j] + 1
    for j in range(n):
        reward[j] = 0.0 if skipped[j] else outcomes[rows[0], j]
    for j in range(n):
        flags[0, j] = outcomes[rows[1], j] != 0.0
    for j in range(n):
        flags[1, j] = limit >= 0 and not skipped[j] and steps[j] + ahead_of_time[j] >= limit
    for j in range(n):
        ended[j] = flags[0, j] or flags[1, j]
    for j in range(n):
        index[count] = j
        count += int(ended[j])
    index[n] = count


@Compiled
def see(first: Integers, outcomes: Rows, seen: Table, achieved: Table, desired: Table) -> None:
    """Observations of all environments, in single precision.

    Args:
        first: rows of the outcomes at which the components of the three parts begin.
        outcomes: a column for each environment.
        seen: to be filled, a row for each environment, as are the next two.
        achieved: goals.
        desired: goals.
    """
    n = seen.shape[0]
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        for i in range(seen.shape[1]):
            for k in range(start, stop):
                seen[k, i] = outcomes[first[0] + i, k]
        for i in range(achieved.shape[1]):
            for k in range(start, stop):
                achieved[k, i] = outcomes[first[1] + i, k]
                desired[k, i] = outcomes[first[2] + i, k]


@Compiled
def see_some(first: Integers, outcomes: Rows, index: Integers, seen: Table, achieved: Table, desired: Table) -> None:
    """The same of the environments at `index`, one after another."""
    for k in range(len(index)):
        for i in range(seen.shape[1]):
            seen[k, i] = outcomes[first[0] + i, index[k]]
        for i in range(achieved.shape[1]):
            achieved[k, i] = outcomes[first[1] + i, index[k]]
            desired[k, i] = outcomes[first[2] + i, index[k]]


@Compiled
def info_entries(
    rows: Integers,
    outcomes: Rows,
    steps: Integers,
    ahead_of_time: Integers,
    floats: Matrix,
    truths: BooleanTable,
    ints: IntegerTable,
) -> None:
    """Entries of `info`, of all environments.

    Args:
        rows: of the outcomes with the floats, the truths and the integers; the time limit.
        outcomes: a column for each environment.
        steps: since the episodes began, behind the integers in `ints`.
        ahead_of_time: by how many steps their time limits come earlier; these limits come last, if `ints` has a row
            for them.
        floats: to be filled, as are the next two.
        truths: the same.
        ints: the same.
    """
    n, place, last = len(steps), 0, len(rows) - 1
    for i in range(floats.shape[0]):
        for j in range(n):
            floats[i, j] = outcomes[rows[place], j]
        place += 1
    for i in range(truths.shape[0]):
        for j in range(n):
            truths[i, j] = outcomes[rows[place], j] != 0.0
        place += 1
    counted = last - place
    for i in range(counted):
        for j in range(n):
            ints[i, j] = int(outcomes[rows[place], j])
        place += 1
    for j in range(n):
        ints[counted, j] = steps[j]
    if ints.shape[0] > counted + 1:
        for j in range(n):
            ints[counted + 1, j] = rows[last] - ahead_of_time[j]


@Compiled
def some_info_entries(
    rows: Integers,
    outcomes: Rows,
    steps: Integers,
    ahead_of_time: Integers,
    index: Integers,
    floats: Matrix,
    truths: BooleanTable,
    ints: IntegerTable,
    mask: Booleans,
) -> None:
    """The same of the environments at `index`, whose mask becomes True; all other columns stay as they are."""
    last = len(rows) - 1
    for k in range(len(index)):
        j, place = index[k], 0
        for i in range(floats.shape[0]):
            floats[i, j] = outcomes[rows[place], j]
            place += 1
        for i in range(truths.shape[0]):
            truths[i, j] = outcomes[rows[place], j] != 0.0
            place += 1
        counted = last - place
        for i in range(counted):
            ints[i, j] = int(outcomes[rows[place], j])
            place += 1
        ints[counted, j] = steps[j]
        if ints.shape[0] > counted + 1:
            ints[counted + 1, j] = rows[last] - ahead_of_time[j]
        mask[j] = True


@Compiled
def take(
    index: Integers,
    following: Integers,
    left: Integers,
    sizes: Integers,
    episodes: Matrix,
    outcomes: Matrix,
    into_episodes: Rows,
    into_outcomes: Rows,
) -> None:
    """Begin the next of the drawn episodes in the environments at `index`, or in none if one of them has none left.

    Args:
        index: of environments.
        following: for each environment, the number of the first episode that has not been drawn.
        left: how many have been drawn and not begun; brought up to date.
        sizes: how many are kept for each environment; a place for whether they were begun.
        episodes: that were drawn: the k-th row of those of an environment is for its episodes k, k + kept, ...
        outcomes: of beginning them.
        into_episodes: a column for each environment.
        into_outcomes: likewise.
    """
    kept = sizes[0]
    sizes[1] = 1
    for k in range(len(index)):
        if left[index[k]] <= 0:
            sizes[1] = 0
    if sizes[1] == 0:
        return
    for k in range(len(index)):
        j = index[k]
        place = j * kept + (following[j] - left[j]) % kept
        left[j] -= 1
        for i in range(into_episodes.shape[0]):
            into_episodes[i, j] = episodes[place, i]
        for i in range(into_outcomes.shape[0]):
            into_outcomes[i, j] = outcomes[place, i]


@Compiled
def put_back(source: Rows, index: Integers, target: Rows) -> None:
    """The columns at `index` of a matrix into another one."""
    for i in range(source.shape[0]):
        for k in range(len(index)):
            target[i, index[k]] = source[i, index[k]]


@Compiled
def keep(matrix: Rows, place: Integers, kept: Matrix) -> None:
    """The columns of a matrix as rows of another one, each at its place."""
    n = len(place)
    for start in range(0, n, BLOCK):
        for i in range(kept.shape[1]):
            for k in range(start, min(start + BLOCK, n)):
                kept[place[k], i] = matrix[i, k]
