"""The 2-X by other routes than the package's: bars by circles, roots by a search that proves its counts, tiny steps."""

import numpy as np


def joint_by_circles(b: float, l: float, phi: float) -> dict[str, complex]:
    """The crossed assembly of one joint as complex points, from the direction phi of its long bar A-C.

    C is at distance l from A in direction phi; D at distance l from B and b from C, the one of the two circle
    intersections for which the bars A-C and B-D cross.
    """
    left, right = complex(-b / 2), complex(b / 2)
    c = left + l * np.exp(1j * phi)
    gap = c - right
    distance = abs(gap)
    along = (distance**2 + l * l - b * b) / (2 * distance)  # from B towards C
    height = np.sqrt(l * l - along * along)
    options = [right + gap / distance * complex(along, sign * height) for sign in (1, -1)]
    d = max(options, key=lambda option: _crossing(left, c, right, option))
    return {"A": left, "B": right, "C": c, "D": d}


def _crossing(a: complex, c: complex, b: complex, d: complex) -> float:
    """Positive where the segments a-c and b-d cross."""

    def side(p: complex, q: complex, r: complex) -> float:
        return ((q - p).conjugate() * (r - p)).imag

    return min(-side(a, c, b) * side(a, c, d), -side(b, d, a) * side(b, d, c))


def meeting_point(p: complex, q: complex, r: complex, s: complex) -> complex:
    """Where the lines p-q and r-s meet."""
    u, v, w = q - p, s - r, r - p
    return p + u * (w.conjugate() * v).imag / (u.conjugate() * v).imag


def angle_gap(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Distance of angles alpha on the full torus, where 4 pi is once around."""
    return abs((first - second + 2 * np.pi) % (4 * np.pi) - 2 * np.pi)


def assert_same_solutions(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    """The same configurations, in any order and on any sheet of the angles."""
    assert len(found) == len(expected), f"{len(found)} solutions, not {len(expected)}: {found}, {expected}"
    gaps = angle_gap(found[:, None], expected[None]).max(axis=2, initial=0.0)
    for table in (gaps, gaps.T):
        assert all(row.min() <= tolerance for row in table), f"{found} differ from {expected}"


class CertifiedRoots:
    """All inverse solutions in |alpha_i| <= limit by subdivision: every cell is proved empty or to hold one root.

    The tip is V(alpha_1) + e^{i alpha_1} (i a + V(alpha_2) + i a e^{i alpha_2}) with V = i r e^{i alpha / 2}. Second
    derivatives are bounded on each cell, so a cell is dropped where |tip - target| exceeds what the cell can make up
    for, and Krawczyk's operator proves or excludes a root where the Jacobian is regular. Cells that are still open at
    the smallest size lie at a
    singularity: their target is `undecided`.
    """

    def __init__(self, b: float, l: float, a: float, limit: float, cells: int = 48) -> None:
        self.b, self.l, self.a, self.limit = b, l, a, limit
        self.half = limit * 1.001 / cells  # slightly beyond the limits, so that none is lost to rounding there
        axis = -limit * 1.001 + self.half * (2 * np.arange(cells) + 1)
        a1, a2 = (grid.ravel() for grid in np.meshgrid(axis, axis, indexing="ij"))
        self.grid = (a1, a2)
        self.first = self._evaluate(a1, a2, self.half)

    def _joint(self, alpha, half):
        s, bb = np.sin(alpha / 2), self.b**2
        r = np.sqrt(self.l**2 - bb + bb * s * s)
        turn = 1j * np.exp(0.5j * alpha)
        dr = bb * np.sin(alpha) / (4 * r)
        smallest = np.maximum(0.0, abs(s) - half / 2)
        r_low = np.sqrt(self.l**2 - bb + bb * smallest**2)
        slope = bb * np.minimum(1.0, 2 * (abs(s) + half / 2)) / (4 * r_low)
        bend = bb / (4 * r_low) + slope**2 / r_low
        return r * turn, (dr + 0.5j * r) * turn, slope + self.l / 2, bend + slope + self.l / 4

    def _evaluate(self, a1, a2, half):
        v1, d1, _, m1 = self._joint(a1, 3 * half)  # bounds for the cell and for three times its size
        v2, d2, n2, m2 = self._joint(a2, 3 * half)
        turn, end, a = np.exp(1j * a1), np.exp(1j * a2), self.a
        tip = v1 + turn * (1j * a + v2 + 1j * a * end)
        j1 = d1 + 1j * turn * (1j * a + v2 + 1j * a * end)
        j2 = turn * (d2 - a * end)
        m11, m12, m22 = m1 + 2 * a + self.l, n2 + a, m2 + a
        # Largest change of each column of the Jacobian over the cell
        return tip, j1, j2, (m11 + m12) * half, (m12 + m22) * half

    def solve(self, x: float, y: float) -> tuple[np.ndarray, bool]:
        """The roots, shape (n, 2), and whether some cell stayed undecided."""
        target = complex(x, y)
        (a1, a2), half, values = self.grid, self.half, self.first
        roots: list[tuple[float, float]] = []
        for _ in range(28):
            tip, j1, j2, w1, w2 = values
            error = tip - target
            possible = abs(error) <= (abs(j1) + abs(j2) + (w1 + w2) / 2) * half
            a1, a2, error, j1, j2, w1, w2 = (v[possible] for v in (a1, a2, error, j1, j2, w1, w2))
            det = (j1.conjugate() * j2).imag
            with np.errstate(divide="ignore", invalid="ignore"):
                # Y = J^-1, applied to a complex column v: ((v x j2), (j1 x v)) / det
                step1, step2 = (error.conjugate() * j2).imag / det, (j1.conjugate() * error).imag / det
                blur1, blur2 = abs(j2) * (w1 + w2) / abs(det) * half, abs(j1) * (w1 + w2) / abs(det) * half
                empty = (abs(step1) > half + blur1) | (abs(step2) > half + blur2)
                certain = (abs(step1) + blur1 < 3 * half) & (abs(step2) + blur2 < 3 * half)
                # A root in the cell is the only one within three half widths if the operator contracts there.
                contracts = 9 * np.maximum(blur1, blur2) < 2.9 * half
                certain &= contracts & (abs(step1) + 9 * blur1 < 2.9 * half) & (abs(step2) + 9 * blur2 < 2.9 * half)
            for i in np.flatnonzero(certain & ~empty):
                roots.append(self._newton(a1[i], a2[i], target))
            open_ = ~empty & ~certain
            a1, a2 = a1[open_], a2[open_]
            if not len(a1):
                break
            half /= 2
            a1 = (a1[:, None] + half * np.array([-1, -1, 1, 1])).ravel()
            a2 = (a2[:, None] + half * np.array([-1, 1, -1, 1])).ravel()
            if len(a1) > 20000:
                return np.array(roots), True
            values = self._evaluate(a1, a2, half)
        distinct: list[tuple[float, float]] = []
        for root in sorted(roots):
            inside = max(abs(root[0]), abs(root[1])) <= self.limit
            if inside and not any(angle_gap(np.array(root), np.array(other)).max() < 1e-9 for other in distinct):
                distinct.append(root)
        return np.array(distinct).reshape(-1, 2), bool(len(a1))

    def _newton(self, a1, a2, target):
        for _ in range(60):
            tip, j1, j2, _, _ = self._evaluate(a1, a2, 0.0)
            error, det = tip - target, (j1.conjugate() * j2).imag
            step = ((error.conjugate() * j2).imag / det, (j1.conjugate() * error).imag / det)
            a1, a2 = a1 - step[0], a2 - step[1]
            if max(abs(step[0]), abs(step[1])) < 1e-14:
                break
        return float(a1), float(a2)


def creep(mechanism, q, old, new, longest=1e-3, shortest=1e-9, move=0.01):
    """Equilibria followed in 1,000 sub-steps or more from tensions `old` to `new`, none moving a joint beyond `move`.

    A sub-step is halved until Newton's method moves that little without meeting an unstable Hessian; stability has
    ended where a fraction of `shortest` is still too long.

    Args:
        mechanism: a batch of designs, shape (n,).
        q: stable equilibria under `old`, shape (2, n).
        old: tensions, shape (4, n).
        new: tensions, shape (4, n).

    Returns:
        Configurations, shape (2, n), fractions covered, and the smallest eigenvalue of the Hessian met on the way.
    """
    q, n = np.array(q, float), q.shape[1]
    t, dt, lowest = np.zeros(n), np.full(n, longest), np.full(n, np.inf)
    active = np.arange(n)
    while len(active):
        part = mechanism.take(active)
        ahead = np.minimum(t[active] + dt[active], 1.0)
        tensions = tuple(old[:, active] + ahead * (new - old)[:, active])
        point, good = q[:, active].copy(), np.ones(len(active), bool)
        for _ in range(5):
            (g1, g2), ((h11, h12), (_, h22)) = part.statics(tuple(point), tensions)
            det = h11 * h22 - h12 * h12
            smallest = (h11 + h22) / 2 - np.sqrt(((h11 - h22) / 2) ** 2 + h12 * h12)
            good &= smallest > 0
            step = np.stack([h22 * g1 - h12 * g2, h11 * g2 - h12 * g1]) / np.where(det == 0, 1.0, det)
            step = np.where(good, step, 0.0)
            point -= step
            if abs(step).max() < 1e-12:
                break
        good &= (abs(step).max(axis=0) < 1e-8) & (abs(point - q[:, active]).max(axis=0) < move)
        to = active[good]
        q[:, to], t[to] = point[:, good], ahead[good]
        lowest[to] = np.minimum(lowest[to], smallest[good])
        dt[active] = np.where(good, np.minimum(1.5 * dt[active], longest), dt[active] / 2)
        active = active[(t[active] < 1.0) & (dt[active] > shortest)]
    return q, t, lowest
