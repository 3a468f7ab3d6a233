"""Which joint moments bounded tensions give: a zonotope, by its facets, on components.

Tensions F in [low, high] give the moments T F, T with a row for each joint and a column for each cable. With the
direction nu normal to a facet, P the sum of the positive nu.T_c and N that of the negative ones, turned positive,

    nu.moments <= high P - low N   for all nu   <=>   some tensions within the bounds give these moments.

A facet is parallel to n - 1 of the columns: all choices of them are tried, and their normals found by minors. Any
direction gives a condition that is necessary, so rounding in nearly degenerate normals does no harm.
"""

import math
from collections.abc import Sequence
from itertools import combinations

from tensegrity_envs.compiler.namespace import Component, Components, Namespace

# rows of entries; None where the cable does not act on the joint
Table = Sequence[Sequence[Component | None]]
_DEGENERATE = 1e-13  # of the normal's columns, relative
_MOST = 1_000_000  # choices of columns: more take hours


def check_choices(cables: int, joints: int, chosen: int) -> None:
    """Raise ValueError where more than a million choices of `chosen` cables are to be tried."""
    choices = math.comb(cables, chosen)
    if choices > _MOST:
        raise ValueError(
            f"{joints} joints with {cables} cables: {choices:,} choices of {chosen} cables to try, more than "
            f"{_MOST:,}: the set of feasible torques is for fewer joints or cables (postures and margins of "
            "routing='per_joint' do without it)"
        )


def facet_normals(table: Table) -> list[list[Component | None]]:
    """Normals of all facets, up to sign and length: each with n components, None for a zero.

    Raises:
        ValueError: there are more than a million choices of n - 1 columns.
    """
    n = len(table)
    check_choices(len(table[0]), n, n - 1)
    rows = tuple(range(n))
    if n == 1:
        return [[1.0]]
    known: dict[tuple[tuple[int, ...], tuple[int, ...]], Component | None] = {}

    def minor(some: tuple[int, ...], columns: tuple[int, ...]) -> Component | None:
        if not some:
            return 1.0
        if (some, columns) not in known:
            total: Component | None = None
            for k, row in enumerate(some):
                entry = table[row][columns[-1]]
                rest = None if entry is None else minor(some[:k] + some[k + 1 :], columns[:-1])
                if entry is not None and rest is not None:
                    term = entry * rest if (k + len(some)) % 2 else -entry * rest
                    total = term if total is None else total + term
            known[some, columns] = total
        return known[some, columns]

    normals = []
    for columns in combinations(range(len(table[0])), n - 1):
        normal = [minor(rows[:j] + rows[j + 1 :], columns) for j in rows]
        if any(component is not None for component in normal):
            normals.append([None if v is None else (v if j % 2 == 0 else -v) for j, v in enumerate(normal)])
    return normals


def largest_lower_bound(xp: Namespace, table: Table, moments: Components, high: Component) -> Component:
    """The largest number such that some tensions between it and `high` give these moments, at most `high`.

    Minus 1e30 times `high` where no lower bound is low enough (of cables that pull one way only).
    """
    bound = high
    for normal in facet_normals(table):
        positive: Component = 0.0
        negative: Component = 0.0
        for c in range(len(table[0])):
            value: Component = 0.0
            for component, row in zip(normal, table, strict=True):
                if component is not None and row[c] is not None:
                    value = value + component * row[c]
            size = abs(value)
            positive, negative = positive + (size + value) / 2, negative + (size - value) / 2
        along: Component = 0.0
        for component, moment in zip(normal, moments, strict=True):
            if component is not None:
                along = along + component * moment
        whole = positive + negative
        for up, down, needed in ((positive, negative, along), (negative, positive, -along)):
            free = high * up - needed
            acts = down > _DEGENERATE * whole
            unbounded = xp.where(free >= -_DEGENERATE * high * whole, high, -1e30 * high)
            bound = xp.minimum(bound, xp.where(acts, free / xp.where(acts, down, 1.0), unbounded))
    return bound
