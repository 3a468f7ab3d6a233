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

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, Namespace

# rows of entries; None where the cable does not act on the joint
Table = Sequence[Sequence[Component | None]]
_DEGENERATE = 1e-13  # of the normal's columns, relative
_DEPENDENT = 1e-12  # of a singular value of the table with rows of length 1, relative
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


def independent_rows(table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal combinations of joints: those on which the cables act independently, and those on which none acts.

    There are some of the latter where a joint is spanned by no cable, or where the cables are too few.

    Args:
        table: shape (n, m).

    Returns:
        shapes (n, rank) and (n, n - rank).
    """
    sizes = np.linalg.norm(table, axis=1)
    left, singular, _ = np.linalg.svd(table / np.where(sizes > 0, sizes, 1.0)[:, None])
    rank = int((singular > _DEPENDENT * singular[0]).sum())
    if rank == len(table):
        return np.eye(rank), np.empty((rank, 0))
    null = left[:, rank:] / np.where(sizes > 0, sizes, 1.0)[:, None]  # of the table as it was given
    whole, _ = np.linalg.qr(null, mode="complete")
    return whole[:, len(table) - rank :], whole[:, : len(table) - rank]


def reduced(table: np.ndarray, moments: np.ndarray, high: float) -> tuple[np.ndarray, np.ndarray] | None:
    """The same conditions table @ F = moments by independent rows; None where no F at all satisfies them."""
    acted, free = independent_rows(table)
    size = np.abs(table).sum(axis=1).max() * high
    if (np.abs(moments @ free) > _DEPENDENT * size).any():
        return None
    return acted.T @ table, acted.T @ moments


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
