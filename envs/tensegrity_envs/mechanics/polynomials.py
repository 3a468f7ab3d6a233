"""All real roots of many polynomials."""

import numpy as np

from tensegrity_envs.compiler.jit import Compiled
from tensegrity_envs.compiler.lowering import Booleans, Matrix

_NEAR = 1e-2  # roots closer together than this all but coincide
LANES = 8  # polynomials that are worked on at once, each as if it were alone


def product(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """rows @ matrix, each row by itself.

    BLAS rounds otherwise for other numbers of rows, and an episode must not depend on those that are drawn with it.

    Args:
        rows: shape (n, m).
        matrix: shape (m, k).
    """
    total: np.ndarray = rows[:, :1] * matrix[0]
    for i in range(1, len(matrix)):
        total += rows[:, i : i + 1] * matrix[i]
    return total


def real_roots(coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The real roots of polynomials, and complex ones that rounding may have moved off the real axis, as real ones.

    Between two neighbouring roots of its derivative a polynomial is monotone; so the roots of the derivatives, from
    the linear one up, bracket those of the polynomial. Where roots all but coincide, which rounding makes a matter of
    chance, they are eigenvalues of the companion matrix instead: a pair next to the real axis is given as its real
    part plus and minus its imaginary part. Whoever needs roots has to verify them.

    Args:
        coefficients: shape (n, degree + 1), lowest power first; the last ones must not be zero.

    Returns:
        The index of the polynomial and the root, each of shape (m,).
    """
    n, size = coefficients.shape
    out = np.full((n, size), np.nan)
    delicate = np.zeros(n, bool)
    _roots(np.ascontiguousarray(coefficients, float), out, delicate)
    if delicate.any():
        some = coefficients[delicate]
        companion = np.zeros((len(some), size - 1, size - 1))
        companion[:, 1:, :-1] = np.eye(size - 2)
        companion[:, :, -1] = -some[:, :-1] / some[:, -1:]
        roots = np.linalg.eigvals(companion)
        # A double root comes out as a pair with imaginary parts of the order of sqrt(eps).
        real = np.abs(roots.imag) < 1e-3 * (1 + np.abs(roots) ** 2)
        out[delicate, :-1] = np.where(real, roots.real + roots.imag, np.nan)
    owner, column = np.nonzero(np.isfinite(out))
    return owner, out[owner, column]


@Compiled
def _roots(coefficients: Matrix, out: Matrix, delicate: Booleans) -> None:
    n, size = coefficients.shape[0], coefficients.shape[1]
    degree = size - 1
    p = np.zeros((size * size, LANES))  # in the rows from k size on, the derivative of degree k
    points, found = np.zeros((size + 1, LANES)), np.zeros((size + 1, LANES))
    bound, count, new = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    left, f_left, right, f_right = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    low, high, x, f, slope = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    is_bracket, running = np.zeros(LANES), np.zeros(LANES)
    for start in range(0, n, LANES):
        for j in range(LANES):
            row = min(start + j, n - 1)
            bound[j], count[j] = 0.0, 0.0
            for i in range(size):
                p[degree * size + i, j] = coefficients[row, i]
                bound[j] = max(bound[j], abs(coefficients[row, i] / coefficients[row, degree]))
            bound[j] += 1.0  # Cauchy's
        for k in range(degree - 1, 0, -1):
            for i in range(k + 1):
                for j in range(LANES):
                    p[k * size + i, j] = p[(k + 1) * size + i + 1, j] * (i + 1)
        for k in range(1, size):
            most = 0
            for j in range(LANES):
                points[int(count[j]), j] = bound[j]
                most = max(most, int(count[j]))
                new[j], left[j], f_left[j] = 0.0, -bound[j], 0.0
            for i in range(k, -1, -1):
                for j in range(LANES):
                    f_left[j] = f_left[j] * left[j] + p[k * size + i, j]
            for interval in range(most + 1):
                for j in range(LANES):
                    right[j] = points[interval, j] if interval <= count[j] else left[j]
                    f_right[j] = 0.0
                for i in range(k, -1, -1):
                    for j in range(LANES):
                        f_right[j] = f_right[j] * right[j] + p[k * size + i, j]
                going_on = 0.0
                for j in range(LANES):
                    is_bracket[j] = 1.0 if (f_left[j] < 0) != (f_right[j] < 0) else 0.0
                    running[j] = is_bracket[j]
                    low[j], high[j], x[j] = left[j], right[j], (left[j] + right[j]) / 2
                for j in range(LANES):
                    going_on = max(going_on, running[j])
                for _ in range(100):
                    if going_on == 0.0:
                        break
                    for j in range(LANES):
                        f[j], slope[j] = 0.0, 0.0
                    for i in range(k, -1, -1):
                        for j in range(LANES):
                            slope[j] = slope[j] * x[j] + f[j]
                            f[j] = f[j] * x[j] + p[k * size + i, j]
                    for j in range(LANES):
                        is_low = (f[j] < 0) == (f_left[j] < 0)
                        low[j] = x[j] if is_low else low[j]
                        high[j] = high[j] if is_low else x[j]
                        newton = f[j] / slope[j]
                        is_inside = low[j] < x[j] - newton < high[j]
                        step = newton if is_inside else (high[j] - low[j]) / 2
                        there = x[j] - newton if is_inside else (high[j] + low[j]) / 2
                        x[j] = there if running[j] != 0.0 else x[j]
                        running[j] = 0.0 if abs(step) < 1e-13 * (1 + abs(x[j])) else running[j]
                    going_on = 0.0
                    for j in range(LANES):
                        going_on = max(going_on, running[j])
                for j in range(LANES):
                    if is_bracket[j] != 0.0:
                        found[int(new[j]), j] = x[j]
                        new[j] += 1.0
                for j in range(LANES):
                    left[j], f_left[j] = right[j], f_right[j]
            if k < degree:
                for j in range(LANES):
                    count[j] = new[j]
                    for i in range(int(new[j])):
                        points[i, j] = found[i, j]
        for j in range(LANES):
            row = start + j
            if row >= n:
                break
            for i in range(int(new[j])):
                out[row, i] = found[i, j]
            for i in range(int(count[j])):
                # From a point c that is next to an m-fold root, the roots are about |p / p_m|^(1/m) away, with the
                # Taylor coefficients p_m at c.
                c, value, factorial = points[i, j], 0.0, 1.0
                for m in range(min(size, 5)):
                    taylor = 0.0
                    factorial *= max(m, 1)
                    for r in range(degree, m - 1, -1):
                        taylor = taylor * c + p[(degree - m) * size + r - m, j] / factorial
                    if m == 0:
                        value = taylor
                    elif m > 1 and abs(value / taylor) ** (1 / m) < _NEAR * (1 + c * c):
                        delicate[row] = True
