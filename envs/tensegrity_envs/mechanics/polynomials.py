"""All real roots of many polynomials."""

import numpy as np

from tensegrity_envs.compiler.jit import Compiled
from tensegrity_envs.compiler.lowering import Booleans, Matrix

_NEAR = 1e-2  # roots closer together than this all but coincide


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
    p = np.zeros((size, size))  # p[k] is the derivative of degree k
    points, found = np.empty(size + 1), np.empty(size)
    for row in range(n):
        bound = 0.0
        for i in range(size):
            p[degree, i] = coefficients[row, i]
            bound = max(bound, abs(coefficients[row, i] / coefficients[row, degree]))
        bound += 1.0  # Cauchy's
        for k in range(degree - 1, 0, -1):
            for i in range(k + 1):
                p[k, i] = p[k + 1, i + 1] * (i + 1)
        count = 0
        for k in range(1, size):
            points[count] = bound
            new = 0
            left, f_left = -bound, 0.0
            for i in range(k, -1, -1):
                f_left = f_left * left + p[k, i]
            for j in range(count + 1):
                right, f_right = points[j], 0.0
                for i in range(k, -1, -1):
                    f_right = f_right * right + p[k, i]
                if (f_left < 0) != (f_right < 0):
                    low, high, x = left, right, (left + right) / 2
                    for _ in range(100):
                        f, slope = 0.0, 0.0
                        for i in range(k, -1, -1):
                            slope = slope * x + f
                            f = f * x + p[k, i]
                        if (f < 0) == (f_left < 0):
                            low = x
                        else:
                            high = x
                        step = f / slope
                        if low < x - step < high:
                            x -= step
                        else:
                            step = (high - low) / 2
                            x = (high + low) / 2
                        if abs(step) < 1e-13 * (1 + abs(x)):
                            break
                    found[new] = x
                    new += 1
                left, f_left = right, f_right
            if k == degree:
                for j in range(new):
                    out[row, j] = found[j]
                for j in range(count):
                    # From a point c that is next to an m-fold root, the roots are about |p / p_m|^(1/m) away, with the
                    # Taylor coefficients p_m at c.
                    c, value, factorial = points[j], 0.0, 1.0
                    for m in range(min(size, 5)):
                        taylor = 0.0
                        factorial *= max(m, 1)
                        for i in range(degree, m - 1, -1):
                            taylor = taylor * c + p[degree - m, i - m] / factorial
                        if m == 0:
                            value = taylor
                        elif m > 1 and abs(value / taylor) ** (1 / m) < _NEAR * (1 + c * c):
                            delicate[row] = True
            count = new
            for j in range(new):
                points[j] = found[j]
