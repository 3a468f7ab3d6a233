"""Roots of many scalar functions at once: bracketing without derivatives, and sign changes hidden between samples."""

from collections.abc import Callable

import numpy as np

_GOLDEN = (np.sqrt(5.0) - 1) / 2


def bracketed_roots(
    f: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray, iterations: int = 60
) -> np.ndarray:
    """A root of each component of f between `low` and `high`, where f has opposite signs, to the last bits of f.

    Chandrupatla's method [Advances in Engineering Software 28(3), 1997]: inverse quadratic interpolation where it is
    safe, bisection elsewhere, so that kinks (the smaller of two margins) do no harm.

    Args:
        f: elementwise function of an array of shape (n,).
        low, high: shape (n,), f(low) and f(high) of opposite signs or zero.
        iterations: at most.

    Returns:
        shape (n,): of all points that were tried, the one where |f| is smallest.
    """
    a, b = np.array(high, float), np.array(low, float)
    if not len(a):
        return a
    fa, fb = f(a), f(b)
    c, fc = a, fa
    enough = 1e-15 * (np.abs(fa) + np.abs(fb))  # what rounding leaves of f
    t = np.full(len(a), 0.5)
    for _ in range(iterations):
        x = a + t * (b - a)
        fx = f(x)
        same = np.sign(fx) == np.sign(fa)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = x, fx
        best = np.where(np.abs(fa) < np.abs(fb), a, b)
        width = np.abs(b - a)
        tolerance = 2 * np.finfo(float).eps * np.abs(best) + 1e-300
        if ((width <= 2 * tolerance) | (np.minimum(np.abs(fa), np.abs(fb)) <= enough)).all():
            break
        with np.errstate(all="ignore"):
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            quadratic = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
            smooth = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi) & np.isfinite(quadratic)
            least = np.clip(np.nan_to_num(tolerance / width, nan=0.5), 0.0, 0.5)
        t = np.clip(np.where(smooth, quadratic, 0.5), least, 1 - least)
    return np.where(np.abs(fa) <= np.abs(fb), a, b)


def circle_roots(
    f: Callable[[np.ndarray, np.ndarray], np.ndarray], lines: int, samples: int, distinct: float = 1e-7
) -> tuple[np.ndarray, np.ndarray]:
    """All roots of functions of an angle, which have no seam: a root at +-pi is found as any other.

    Args:
        f: (line, angle) -> value, elementwise, of period 2 pi; line is an index array of the same shape as angle.
        lines: number of functions.
        samples: of each, between which sign changes are looked for, too (`hidden_sign_changes`).
        distinct: roots closer together than this are one.

    Returns:
        line and angle in (-pi, pi] of every root, by line.
    """
    turn = 2 * np.pi
    x = np.tile(-np.pi + turn * np.arange(-1, samples + 1) / samples, (lines, 1))
    line = np.arange(lines)[:, None]
    values = f(np.broadcast_to(line, x[:, 1:-1].shape), x[:, 1:-1])
    values = np.concatenate([values[:, -1:], values, values[:, :1]], axis=1)
    hidden, place = hidden_sign_changes(f, x, values)
    first = x[0, 1]
    place = first + (place - first) % turn
    found_line, found = [], []
    for k in range(lines):
        angle = np.concatenate([x[k, 1:-1], place[hidden == k]])
        value = np.concatenate([values[k, 1:-1], f(np.full((hidden == k).sum(), k), place[hidden == k])])
        order = np.argsort(angle, kind="stable")
        angle, sign = np.append(angle[order], angle[order[0]] + turn), np.append(value[order], value[order[0]]) > 0
        change = np.flatnonzero(sign[1:] != sign[:-1])

        def on_line(a: np.ndarray, k: int = k) -> np.ndarray:
            return f(np.full(a.shape, k), first + (a - first) % turn)  # one rounding, one sign, for an angle

        roots = bracketed_roots(on_line, angle[change], angle[change + 1])
        roots = np.pi - (np.pi - roots) % turn
        kept: list[float] = []
        for root in roots.tolist():
            if all(abs((root - other + np.pi) % turn - np.pi) > distinct for other in kept):
                kept.append(root)
        found_line.append(np.full(len(kept), k))
        found.append(np.array(kept))
    return np.concatenate(found_line), np.concatenate(found)


def hidden_sign_changes(
    f: Callable[[np.ndarray, np.ndarray], np.ndarray], x: np.ndarray, values: np.ndarray, iterations: int = 30
) -> tuple[np.ndarray, np.ndarray]:
    """Points where functions change sign between samples that show no change: humps and dips narrower than a step.

    Every sample at which |f| is smaller than at its neighbours of the same sign, and steep enough for zero to be within
    reach, is the centre of a golden-section search for a point of the other sign.

    Args:
        f: (line, x) -> value, elementwise; line is an index array of the same shape as x.
        x: samples, shape (lines, n), increasing along each line.
        values: f there, shape (lines, n).
        iterations: of the golden section, each of which shortens the interval by 0.62.

    Returns:
        line and x of the points that were found, at most one for each sample.
    """
    size = np.abs(values)
    padded = np.pad(size, ((0, 0), (1, 1)), constant_values=np.inf)
    positive = np.pad(values > 0, ((0, 0), (1, 1)), mode="edge")
    left, right = padded[:, :-2], padded[:, 2:]
    alike = (positive[:, :-2] == positive[:, 1:-1]) & (positive[:, 2:] == positive[:, 1:-1])
    rise = np.maximum(np.where(np.isfinite(left), left, 0.0), np.where(np.isfinite(right), right, 0.0)) - size
    line, i = np.nonzero(alike & (size <= left) & (size <= right) & (size < 2 * rise))
    if not len(line):
        return line, np.empty(0)
    sign = np.where(values[line, i] > 0, 1.0, -1.0)
    before, after = np.maximum(i - 1, 0), np.minimum(i + 1, x.shape[1] - 1)
    low, high, f_low, f_high = x[line, before], x[line, after], size[line, before], size[line, after]
    p, q = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    fp, fq = sign * f(line, p), sign * f(line, q)
    found_line, found = [line[:0]], [low[:0]]
    for _ in range(iterations):
        smaller = fp < fq
        best, point = np.where(smaller, fp, fq), np.where(smaller, p, q)
        crossed = best < 0
        if crossed.any():
            found_line.append(line[crossed])
            found.append(point[crossed])
        # Out of reach: on what is left of the interval f does not change by as much as it would take.
        going = ~crossed & (best < 2 * (np.maximum(f_low, f_high) - best))
        if not going.any():
            break
        line, sign, smaller = line[going], sign[going], smaller[going]
        low, high, p, q, f_low, f_high, fp, fq = (v[going] for v in (low, high, p, q, f_low, f_high, fp, fq))
        low, f_low = np.where(smaller, low, p), np.where(smaller, f_low, fp)
        high, f_high = np.where(smaller, q, high), np.where(smaller, fq, f_high)
        new = np.where(smaller, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        f_new = sign * f(line, new)
        p, q = np.where(smaller, new, q), np.where(smaller, p, new)
        fp, fq = np.where(smaller, f_new, fq), np.where(smaller, fp, f_new)
    return np.concatenate(found_line), np.concatenate(found)
