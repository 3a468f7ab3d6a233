"""All real roots of many polynomials."""

import numpy as np

from tensegrity_envs.compiler.jit import Compiled
from tensegrity_envs.compiler.lowering import Booleans, Integers, Matrix

_NEAR = 1e-2  # roots closer together than this all but coincide
LANES = 24  # polynomials that are worked on at once, each as if it were alone
CLOSE, CLOSE_ENOUGH = 1e-8, 1e-5  # last step to a root, and to one of a derivative; the error is as its square
SIZE = 9  # coefficients of the largest polynomials that are not left to the eigenvalues


def product(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """rows @ matrix, each row by itself.

    BLAS rounds otherwise for other numbers of rows, and an episode must not depend on those that are drawn with it.

    Args:
        rows: shape (n, m).
        matrix: shape (m, k).
    """
    out = np.empty((len(rows), matrix.shape[1]))
    _product.run(np.ascontiguousarray(rows, float), np.ascontiguousarray(matrix, float), out)
    return out


@Compiled
def _product(rows: Matrix, matrix: Matrix, out: Matrix) -> None:
    for k in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[k, j] = rows[k, 0] * matrix[0, j]
        for i in range(1, matrix.shape[0]):
            for j in range(out.shape[1]):
                out[k, j] += rows[k, i] * matrix[i, j]


def turned_product(samples: tuple[np.ndarray, ...], matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples, begun at the largest one, times a matrix; those of each target by themselves, see `product`.

    Args:
        samples: m arrays of shape (n,).
        matrix: shape (m, k).

    Returns:
        Which sample is the largest by magnitude, shape (n,), and the products, shape (n, k).
    """
    n = len(samples[0])
    top, out = np.zeros(n, np.int64), np.empty((n, matrix.shape[1]))
    _turned_product(np.stack(samples), np.ascontiguousarray(matrix), top, out)
    return top, out


@Compiled
def _turned_product(samples: Matrix, matrix: Matrix, top: Integers, out: Matrix) -> None:
    m = samples.shape[0]
    for k in range(out.shape[0]):
        largest = -1.0
        for i in range(m):
            if abs(samples[i, k]) > largest:
                largest = abs(samples[i, k])
                top[k] = i
        for j in range(out.shape[1]):
            out[k, j] = 0.0
        for i in range(m):
            value = samples[(top[k] + i) % m, k]
            for j in range(out.shape[1]):
                out[k, j] += value * matrix[i, j]


def real_roots(coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The real roots of polynomials, and complex ones that rounding may have moved off the real axis, as real ones.

    Between two neighbouring roots of its derivative a polynomial is monotone; so the roots of the derivatives, from
    the linear one up, bracket those of the polynomial. Where roots all but coincide, which rounding makes a matter of
    chance, they are eigenvalues of the companion matrix instead: a pair next to the real axis is given as its real
    part plus and minus its imaginary part. Roots are good to 1e-8 at least; whoever needs them has to verify them.

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
    if size > SIZE:
        for row in range(n):
            delicate[row] = True
        return
    p = np.zeros((SIZE * SIZE, LANES))  # in the rows from k SIZE on, the derivative of degree k; zero beyond
    points, found = np.zeros((SIZE + 1, LANES)), np.zeros((SIZE + 1, LANES))
    bound, count, new = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    left, f_left, right, f_right = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    low, high, x = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    is_bracket, running = np.zeros(LANES), np.zeros(LANES)
    for start in range(0, n, LANES):
        for j in range(LANES):
            row = min(start + j, n - 1)
            bound[j], count[j] = 0.0, 0.0
            for i in range(size):
                p[degree * SIZE + i, j] = coefficients[row, i]
                bound[j] = max(bound[j], abs(coefficients[row, i] / coefficients[row, degree]))
            bound[j] += 1.0  # Cauchy's
        for k in range(degree - 1, 0, -1):
            for i in range(k + 1):
                for j in range(LANES):
                    p[k * SIZE + i, j] = p[(k + 1) * SIZE + i + 1, j] * (i + 1)
        for k in range(1, size):
            most, q, tolerance = 0, k * SIZE, CLOSE if k == degree else CLOSE_ENOUGH
            for j in range(LANES):
                points[int(count[j]), j] = bound[j]
                most = max(most, int(count[j]))
                new[j], left[j] = 0.0, -bound[j]
                y = p[q + 8, j]
                y = y * left[j] + p[q + 7, j]
                y = y * left[j] + p[q + 6, j]
                y = y * left[j] + p[q + 5, j]
                y = y * left[j] + p[q + 4, j]
                y = y * left[j] + p[q + 3, j]
                y = y * left[j] + p[q + 2, j]
                y = y * left[j] + p[q + 1, j]
                f_left[j] = y * left[j] + p[q, j]
            for interval in range(most + 1):
                going_on = 0
                for j in range(LANES):
                    z = points[interval, j] if interval <= count[j] else left[j]
                    y = p[q + 8, j]
                    y = y * z + p[q + 7, j]
                    y = y * z + p[q + 6, j]
                    y = y * z + p[q + 5, j]
                    y = y * z + p[q + 4, j]
                    y = y * z + p[q + 3, j]
                    y = y * z + p[q + 2, j]
                    y = y * z + p[q + 1, j]
                    right[j], f_right[j] = z, y * z + p[q, j]
                    is_bracket[j] = 1.0 if (f_left[j] < 0) != (f_right[j] < 0) else 0.0
                    running[j] = is_bracket[j]
                    low[j], high[j], x[j] = left[j], right[j], (left[j] + right[j]) / 2
                    # Far from all roots Newton's steps are short: begin near the outermost points, not near the bounds.
                    x[j] = max(x[j], right[j] - 1 - abs(right[j])) if interval == 0 and count[j] > 0 else x[j]
                    x[j] = min(x[j], left[j] + 1 + abs(left[j])) if interval == count[j] and count[j] > 0 else x[j]
                for j in range(LANES):
                    going_on += int(running[j] != 0.0)
                for _ in range(100):
                    if going_on == 0:
                        break
                    for j in range(LANES):
                        z = x[j]
                        y = p[q + 8, j]
                        dy = y
                        y = y * z + p[q + 7, j]
                        dy = dy * z + y
                        y = y * z + p[q + 6, j]
                        dy = dy * z + y
                        y = y * z + p[q + 5, j]
                        dy = dy * z + y
                        y = y * z + p[q + 4, j]
                        dy = dy * z + y
                        y = y * z + p[q + 3, j]
                        dy = dy * z + y
                        y = y * z + p[q + 2, j]
                        dy = dy * z + y
                        y = y * z + p[q + 1, j]
                        dy = dy * z + y
                        y = y * z + p[q, j]
                        is_low = (y < 0) == (f_left[j] < 0)
                        low[j] = z if is_low else low[j]
                        high[j] = high[j] if is_low else z
                        step = y / dy
                        is_inside = low[j] < z - step < high[j]
                        there = z - step if is_inside else (high[j] + low[j]) / 2
                        step = step if is_inside else (high[j] - low[j]) / 2
                        x[j] = there if running[j] != 0.0 else z
                        running[j] = 0.0 if abs(step) < tolerance * (1 + abs(x[j])) else running[j]
                    going_on = 0
                    for j in range(LANES):
                        going_on += int(running[j] != 0.0)
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
                # Taylor coefficients p_m at c, which are the derivatives divided by m!.
                c, value, factorial = points[i, j], 0.0, 1.0
                near = _NEAR * (1 + c * c)
                power = near
                for r in range(degree, -1, -1):
                    value = value * c + p[degree * SIZE + r, j]
                for m in range(2, min(size, 5)):
                    derivative = 0.0
                    factorial *= m
                    power *= near
                    for r in range(degree - m, -1, -1):
                        derivative = derivative * c + p[(degree - m) * SIZE + r, j]
                    if abs(value) * factorial < abs(derivative) * power:
                        delicate[row] = True
