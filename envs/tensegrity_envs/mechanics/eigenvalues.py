"""The smallest eigenvalue of a small symmetric matrix, on components."""

import math
import sys
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import (
    Component,
    Components,
    is_batch,
    is_jax,
    is_symbol,
    is_tensor,
    namespace_of,
)

_SWEEPS = 6  # of rotations: after four of them the entries beside the diagonal are a matter of rounding


def smallest_eigenvalue(matrix: tuple[Components, ...]) -> Component:
    """Smallest eigenvalue of a symmetric n x n matrix: in closed form up to n = 3, by iteration beyond.

    n = 3: with B the traceless part, m = tr/3, |B|^2 = 6 p^2 and C = B^2 - |B|^2 / 3,

        eigenvalue = m - 2 p cos(pi/3 - phi),  3 phi = atan2(sqrt(|B|^2 |C|^2 - <B, C>^2), <B, C>).

    The usual acos(det(B) / 2 p^3) loses half of the digits where two eigenvalues are close. Here the sine comes from
    Lagrange's identity, a sum of squares, and the error stays at a few roundings of the largest entry.
    """
    n = len(matrix)
    if n == 1:
        return matrix[0][0]
    if n > 3:
        return _smallest_by_iteration(matrix)
    xp = namespace_of(*(matrix[i][j] for i in range(n) for j in range(i, n)))
    if n == 2:
        half = (matrix[0][0] - matrix[1][1]) / 2
        return (matrix[0][0] + matrix[1][1]) / 2 - xp.hypot(half, matrix[0][1])
    (a, d, e), (_, b, f), (_, _, c) = matrix
    mean = (a + b + c) / 3
    a, b, c = ((a - b) + (a - c)) / 3, ((b - a) + (b - c)) / 3, ((c - a) + (c - b)) / 3
    dd, ee, ff = d * d, e * e, f * f
    square = a * a + b * b + c * c + 2 * (dd + ee + ff)
    third = square / 3
    # B and C as vectors of R^6 with the weights 1, 1, 1, 2, 2, 2
    first = (a, b, c, d, e, f)
    second = (
        a * a + dd + ee - third,
        b * b + dd + ff - third,
        c * c + ee + ff - third,
        e * f - c * d,  # (a + b) d + e f, since a + b + c = 0
        d * f - b * e,
        d * e - a * f,
    )
    inner = a * second[0] + b * second[1] + c * second[2] + 2 * (d * second[3] + e * second[4] + f * second[5])
    total = 0.0
    for i in range(6):
        for j in range(i + 1, 6):
            minor = first[i] * second[j] - first[j] * second[i]
            total = total + (1 if j < 3 else 2 if i < 3 else 4) * minor * minor
    angle = xp.atan2(xp.sqrt(total), inner) / 3
    return mean - 2 * xp.sqrt(square / 6) * xp.cos(math.pi / 3 - angle)


def _smallest_by_iteration(matrix: tuple[Components, ...]) -> Component:
    entries = [entry for row in matrix for entry in row]
    if is_symbol(*entries):
        return _smallest_by_rotations(matrix)
    if not is_batch(*entries):
        return float(np.linalg.eigvalsh(np.array(matrix, float))[0])
    if any(map(is_tensor, entries)):
        torch = sys.modules["torch"]
        tensor = torch.stack(torch.broadcast_tensors(*map(torch.as_tensor, entries)), dim=-1)
        return torch.linalg.eigvalsh(tensor.reshape(*tensor.shape[:-1], len(matrix), len(matrix)))[..., 0]
    xp: Any = sys.modules["jax.numpy"] if any(map(is_jax, entries)) else np
    stacked = xp.stack(xp.broadcast_arrays(*entries), axis=-1)
    n = len(matrix)
    return xp.linalg.eigvalsh(stacked.reshape(*stacked.shape[:-1], n, n))[..., 0]


def _smallest_by_rotations(matrix: tuple[Components, ...]) -> Component:
    """By Jacobi's rotations in a fixed number of sweeps, which a traced function can do."""
    n = len(matrix)
    a = [list(row) for row in matrix]
    xp = namespace_of(*(entry for row in matrix for entry in row))
    for _ in range(_SWEEPS):
        for p in range(n):
            for q in range(p + 1, n):
                off, gap = a[p][q], a[q][q] - a[p][p]
                size = abs(gap) + xp.sqrt(gap * gap + 4 * off * off)
                t = xp.where(gap < 0, -2.0, 2.0) * off / xp.where(size > 0, size, 1.0)
                c = 1 / xp.sqrt(1 + t * t)
                s = t * c
                a[p][p], a[q][q] = a[p][p] - t * off, a[q][q] + t * off
                a[p][q] = a[q][p] = 0.0
                for k in range(n):
                    if k not in (p, q):
                        a[k][p], a[k][q] = c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]
                        a[p][k], a[q][k] = a[k][p], a[k][q]
    smallest = a[0][0]
    for k in range(1, n):
        smallest = xp.minimum(smallest, a[k][k])
    return smallest
