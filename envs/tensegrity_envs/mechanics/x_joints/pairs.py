"""All configurations of two X-joints, equal or not, whose tip is at a target: the roots of one polynomial each.

`curve` derives it. There are at most eight solutions, the real roots of a polynomial of degree eight. (Without offsets
and with equal joints h^2 divides it; what is left is the quartic of [Furet2018, Eqs. 3-8] in another variable.)
"""

import math
from typing import NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.checks import check_finite
from tensegrity_envs.mechanics.polynomials import real_roots, turned_product
from tensegrity_envs.mechanics.roots import circle_roots
from tensegrity_envs.mechanics.sorting import order_within
from tensegrity_envs.mechanics.x_joints import curve
from tensegrity_envs.mechanics.x_joints.curve import SAMPLES, Pair, beyond, from_anomaly, off_curve
from tensegrity_envs.mechanics.x_joints.joint import Bars

_FULL_TURN = 4 * math.pi  # of alpha, since theta = alpha / 2 runs once around
_NEARLY_SINGULAR = 2e-3  # 1 - (b/l)^2, where the polynomial is not enough
_VALLEY = 4e-15  # of the reach: tips of nearly equal bars that are no further apart are the same but for rounding
_GRID = 25  # starts along each joint, for nearly equal bars
_ROUNDING = 1e-6  # [rad] by which rounding may carry a double root beyond a joint limit


def _samples_to_polynomial() -> np.ndarray:
    """The matrix from samples of a trigonometric polynomial of order 4 at pi + 2 pi j / 16 to p_0 ... p_8.

    With t = tan(omega/2) the trigonometric polynomial is (p_0 + ... + p_8 t^8) / (1 + t^2)^4.
    """
    half = (math.pi + np.arange(SAMPLES) * (2 * math.pi / SAMPLES)) / 2
    power = np.arange(9)
    return np.linalg.pinv(np.sin(half)[:, None] ** power * np.cos(half)[:, None] ** (8 - power)).T


_SAMPLES_TO_POLYNOMIAL = _samples_to_polynomial()


def solve(arm: Pair, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Candidates, polished and verified: index of the target, configuration [rad] and residual [m] of every solution.

    Raises:
        ValueError: a number is not finite, or bar lengths differ within a batch of designs.
    """
    if any(isinstance(value, np.ndarray) for bars in arm.bars for value in bars):
        raise ValueError("inverse kinematics takes one set of bar lengths, not a batch of them")
    check_finite("target", (x, y), 2)
    equal_bars = _flatness(arm) < _NEARLY_SINGULAR  # many candidates, the best of which are kept
    owner, a1, a2 = _candidates(arm, x, y)
    near = np.maximum(np.abs(a1), np.abs(a2)) < arm.design.joint_limit + 0.1
    owner, a1, a2 = owner[near], a1[near], a2[near]
    a1, a2 = _polish(arm, x[owner], y[owner], a1, a2)
    if equal_bars:
        a1, a2 = _along_valleys(arm, x[owner], y[owner], a1, a2)
    a1, a2 = (2 * math.pi - (2 * math.pi - alpha) % _FULL_TURN for alpha in (a1, a2))  # into (-2 pi, 2 pi]
    a1, a2 = _onto_limits(arm, x[owner], y[owner], a1, a2)
    residual = evaluate(curve.distance, arm.geometry, x[owner], y[owner], a1, a2)
    rounding = (_VALLEY if equal_bars else 1e-12) * arm.reach
    keep = (residual < rounding) & (np.maximum(np.abs(a1), np.abs(a2)) <= arm.design.joint_limit)
    if arm.design.joint_limit <= math.pi:  # which leaves the flat poses out
        keep &= np.maximum(np.abs(a1), np.abs(a2)) < math.pi - 1e-9
    found = _Candidates(owner, a1, a2, residual).at(keep)
    if equal_bars:
        found = found.at(np.lexsort((found.residual, found.owner)))
        found = found.at(_leaders(arm, x, y, found)).in_order()
    else:
        found = found.in_order()
        found = found.at(_new_solutions(arm, x, y, found))
    return found.owner, (found.a1, found.a2), found.residual


class _Candidates(NamedTuple):
    """What may be solutions: index of the target, angles [rad] and residual [m], each of shape (n,)."""

    owner: np.ndarray
    a1: np.ndarray
    a2: np.ndarray
    residual: np.ndarray

    def at(self, index: np.ndarray) -> "_Candidates":
        """Those at `index`, or where it is true."""
        return _Candidates(*(values[index] for values in self))

    def in_order(self) -> "_Candidates":
        """By target, and by angles within each."""
        return self.at(order_within(self.owner, self.a1, self.a2))


def _new_solutions(arm: Pair, x: np.ndarray, y: np.ndarray, found: _Candidates) -> np.ndarray:
    """Which candidates are solutions of their own; others differ by rounding, sqrt(eps) at a double root."""
    owner, a1, a2, residual = found
    new = np.ones(len(owner), bool)
    for lag in range(1, len(owner)):
        same = owner[lag:] == owner[:-lag]
        if not same.any():
            break
        apart = np.abs(a1[lag:] - a1[:-lag])
        first = np.flatnonzero(same & ((apart < 1e-5) | (apart > _FULL_TURN - 1e-5)))
        if not len(first):
            continue
        second = first + lag
        gap = _angle_gap(a1[second], a1[first]) + _angle_gap(a2[second], a2[first])
        one = gap <= 1e-6
        near = ~one & (gap < 1e-5)  # of a double root: what lies between is as good
        i, j = first[near], second[near]
        px, py = arm.tip(tuple((a[j] + a[i]) / 2 for a in (a1, a2)))
        between = np.hypot(px - x[owner[j]], py - y[owner[j]])
        one[near] = between <= np.maximum(residual[j], residual[i])
        new[second[one]] = False
    return new


def _leaders(arm: Pair, x: np.ndarray, y: np.ndarray, found: _Candidates) -> np.ndarray:
    """The same for nearly equal bars, whose solutions are long valleys; the best candidates come first.

    A candidate belongs to a better one where the tip, all the way between them along the valley's floor, is no
    further from the target than at the worse of the two, or than rounding.
    """
    owner, a1, a2, residual = found
    new = np.zeros(len(owner), bool)
    left = np.arange(len(owner))
    rounding = _VALLEY * arm.reach
    between = np.linspace(0.0, 1.0, 18)[1:-1, None]
    while len(left):
        _, first, group = np.unique(owner[left], return_index=True, return_inverse=True)
        new[left[first]] = True
        best = left[first][group]
        ways = [(alpha[left] - alpha[best] + 2 * math.pi) % _FULL_TURN - 2 * math.pi for alpha in (a1, a2)]
        q = (a1[best] + between * ways[0], a2[best] + between * ways[1])
        length = np.abs(ways[0]) + np.abs(ways[1])
        for _ in range(4):  # down the gradient, to the floor of a bent valley
            px, py = arm.tip(q)
            ex, ey = px - x[owner[left]], py - y[owner[left]]
            rows = arm.jacobian(q)
            square = sum(part * part for row in rows for part in row) + 1e-300
            steps = [(rows[0][i] * ex + rows[1][i] * ey) / square for i in range(2)]
            shrink = 0.1 * length / np.maximum(0.1 * length + 1e-300, np.hypot(*steps))
            q = (q[0] - shrink * steps[0], q[1] - shrink * steps[1])
        px, py = arm.tip(q)
        off = np.hypot(px - x[owner[left]], py - y[owner[left]]).max(axis=0)
        one = (length <= 1e-6) | (off <= np.maximum(residual[left], rounding))
        left = left[~one]
    return new


def _onto_limits(
    arm: Pair, x: np.ndarray, y: np.ndarray, a1: np.ndarray, a2: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Angles that rounding has carried beyond a joint limit, put onto it; the other joint makes up for it."""
    limit, outside, stride = arm.design.joint_limit, _ROUNDING, 1e-3
    if _flatness(arm) < _NEARLY_SINGULAR:  # valleys along which the tip moves less than rounding
        outside = stride = 0.3
        if limit == math.pi:
            limit -= 2e-9  # since a flat pose counts as none
    over = [np.abs(alpha) > limit for alpha in (a1, a2)]
    index = np.flatnonzero((over[0] | over[1]) & (np.maximum(np.abs(a1), np.abs(a2)) < limit + outside))
    if not len(index):
        return a1, a2
    q = [np.clip(alpha[index], -limit, limit) for alpha in (a1, a2)]
    free = [~part[index] for part in over]
    for _ in range(20):
        px, py = arm.tip((q[0], q[1]))
        ex, ey = px - x[index], py - y[index]
        rows = arm.jacobian((q[0], q[1]))
        for i in range(2):
            dx, dy = rows[0][i], rows[1][i]
            step = (dx * ex + dy * ey) / (dx * dx + dy * dy + 1e-300)
            q[i] = np.where(free[i], np.clip(q[i] - np.clip(step, -stride, stride), -limit, limit), q[i])
    a1, a2 = a1.copy(), a2.copy()
    a1[index], a2[index] = q
    return a1, a2


def _polish(arm: Pair, x: np.ndarray, y: np.ndarray, a1: np.ndarray, a2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Damped Newton steps from every candidate to its target: the best point of each way.

    Steps that lead further away are taken back, and damped more: next to a singularity, where two solutions meet,
    full steps would run along the direction that moves the tip least.
    """
    a1, a2, damped = a1.copy(), a2.copy(), np.full(len(a1), 1e-3)
    active, geometry = np.arange(len(a1)), arm.geometry
    for _ in range(60 // curve.POLISHING_STEPS):
        if not len(active):
            break
        given = (x[active], y[active], a1[active], a2[active], damped[active])
        a1[active], a2[active], damped[active], going_on = evaluate(curve.polished, geometry, *given)
        active = active[going_on]
    return a1, a2


def _along_valleys(
    arm: Pair, x: np.ndarray, y: np.ndarray, a1: np.ndarray, a2: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Newton steps that may lead further away: a step along a bent valley leaves it, the next one returns to it."""
    best1, best2 = a1.copy(), a2.copy()
    least = np.full(len(a1), np.inf)
    for _ in range(12):
        px, py = arm.tip((a1, a2))
        ex, ey = px - x, py - y
        error = np.hypot(ex, ey)
        better = error < least
        least = np.where(better, error, least)
        best1, best2 = np.where(better, a1, best1), np.where(better, a2, best2)
        (xa, xb), (ya, yb) = arm.jacobian((a1, a2))
        det = xa * yb - xb * ya
        det = np.where(det == 0, np.inf, det)
        step1, step2 = (yb * ex - xb * ey) / det, (xa * ey - ya * ex) / det
        shrink = 0.3 / np.maximum(0.3, np.hypot(step1, step2))
        a1, a2 = a1 - shrink * step1, a2 - shrink * step2
    return best1, best2


def _candidates(arm: Pair, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A starting point close to every solution: index of the target, alpha_1, alpha_2."""
    first, second = arm.bars
    distance = np.maximum(np.abs(x), np.abs(y))
    if first == second and first.a == 0 and (distance < 1e-12 * first.l).any():
        raise ValueError("target (0, 0): the base, which every configuration with alpha_1 + alpha_2 = +-2 pi reaches")
    within = np.flatnonzero(distance <= arm.reach)
    x, y = x[within], y[within]
    flatness, geometry = _flatness(arm), arm.geometry
    # The variable is t = tan(omega/2), with t = infinity where the sample is largest: no root is near infinity.
    top, polynomial = turned_product(evaluate(curve.samples, geometry, x, y), _SAMPLES_TO_POLYNOMIAL)
    owner, t = real_roots(polynomial)
    a1 = evaluate(curve.first_angle, geometry, top[owner] * (2 * math.pi / SAMPLES), t)
    # Ill-conditioned where the bars are nearly equal: all but the smallest angles have anomalies next to pi / 2.
    if flatness < _NEARLY_SINGULAR:
        more = _scanned(arm, x, y)
        owner, a1 = np.concatenate([owner, more[0]]), np.concatenate([a1, more[1]])
    a2, u, rc, rr = evaluate(curve.second_angle, geometry, x[owner], y[owner], a1)
    node, fold = crossings(second, u, rc, rr)
    owner = within[owner]
    owner, a1, a2 = (
        np.concatenate([owner, owner[node], owner[node]]),
        np.concatenate([a1, a1[node], a1[node]]),
        np.concatenate([a2, fold, -fold]),
    )
    if flatness < _NEARLY_SINGULAR:  # and alpha_2 from alpha_1 is ill-conditioned at singularities and limits
        limit = arm.design.joint_limit
        axis = np.linspace(-limit, limit, _GRID)
        # A joint whose midpoints meet turns within angles of this size.
        near = np.geomspace(math.sqrt(flatness), 0.1, 6)
        axis = np.concatenate([axis, near, -near, 2 * math.pi - near, near - 2 * math.pi])
        axis = axis[np.abs(axis) <= limit]
        grid = [part.ravel() for part in np.meshgrid(axis, axis)]
        owner = np.concatenate([owner, np.repeat(within, len(grid[0]))])
        a1, a2 = (np.concatenate([a, np.tile(part, len(within))]) for a, part in zip((a1, a2), grid, strict=True))
    return owner, a1, a2


def _scanned(arm: Pair, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the target and alpha_1 of solutions, by even scans of the circle of alpha_1 and of its anomaly."""
    n = len(x)
    first, second = arm.bars

    def off(line: np.ndarray, angle: np.ndarray) -> np.ndarray:
        a1 = np.where(line < n, 2 * angle, from_anomaly(first, angle))
        _, dy, dd = beyond(first, x[line % n], y[line % n], a1)
        return np.asarray(off_curve(second, dy, dd))

    if not n:
        return np.zeros(0, int), np.zeros(0)
    line, angle = circle_roots(off, 2 * n, 720, 1e-12)
    return line % n, np.where(line < n, 2 * angle, from_anomaly(first, angle))


def crossings(bars: Bars, u: np.ndarray, rc: np.ndarray, rr: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the curve all but crosses itself (u = 0), and where a point belongs to both signs of an angle.

    Args:
        bars: of the joint.
        u, rc, rr: see `curve.angle_on_curve`, each of shape (m,).

    Returns:
        The indices of these points, shape (k,), and the angle of one sign [rad], shape (k,).
    """
    node = np.flatnonzero(np.abs(u) < 1e-3 * bars.l * bars.l)
    return node, 2 * np.arccos(np.clip(rc[node] / np.sqrt(rr[node] + 1e-300), -1.0, 1.0))


def _flatness(arm: Pair) -> float:
    """That of the flatter joint."""
    return min(float(bars.flatness) for bars in arm.bars)


def _angle_gap(first: Component, second: Component) -> Component:
    gap = np.abs(first - second) % _FULL_TURN
    return np.minimum(gap, _FULL_TURN - gap)
