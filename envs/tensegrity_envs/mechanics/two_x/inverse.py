"""Inverse kinematics of the 2-X manipulator: every configuration with the tip at a target, roots of one polynomial."""

import math
from typing import NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.checks import check_finite
from tensegrity_envs.mechanics.polynomials import real_roots, turned_product
from tensegrity_envs.mechanics.roots import circle_roots
from tensegrity_envs.mechanics.sorting import order_within
from tensegrity_envs.mechanics.two_x import curve
from tensegrity_envs.mechanics.two_x.curve import SAMPLES, beyond_joint_1, from_anomaly, off_curve, second_angle
from tensegrity_envs.mechanics.two_x.kinematics import TwoXKinematics

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


class InverseSolution(NamedTuple):
    """One solution of the inverse kinematics.

    Attributes:
        configuration: (alpha_1, alpha_2) [rad].
        state: "U" (up, |alpha| < pi) or "D" (down) for each joint, such as "UD".
        singularity: det J [m2]; its sign tells the aspect.
        stability_margin: see `TwoX.stability_margin`.
        wrench_margin: see `TwoX.wrench_margin`.
        residual: distance of its forward kinematics from the target [m].
    """

    configuration: tuple[float, float]
    state: str
    singularity: float
    stability_margin: float
    wrench_margin: float
    residual: float

    @property
    def is_stable_wrench_feasible(self) -> bool:
        """Whether feasible tensions hold this configuration in stable equilibrium."""
        return self.stability_margin > 0 and self.wrench_margin >= 0


def solve(
    arm: TwoXKinematics, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Candidates, polished and verified: index of the target, configuration [rad] and residual [m] of every solution.

    Raises:
        ValueError: a number is not finite, or bar lengths differ within a batch of designs.
    """
    if any(isinstance(value, np.ndarray) for value in (arm.design.a, arm.design.b, arm.design.l)):
        raise ValueError("inverse kinematics takes one set of bar lengths, not a batch of them")
    check_finite("target", (x, y), 2)
    equal_bars = arm._excess < _NEARLY_SINGULAR * arm.design.l**2  # many candidates, the best of which are kept
    owner, a1, a2 = _candidates(arm, x, y)
    near = np.maximum(np.abs(a1), np.abs(a2)) < arm.design.joint_limit + 0.1
    owner, a1, a2 = owner[near], a1[near], a2[near]
    a1, a2 = _polish(arm, x[owner], y[owner], a1, a2)
    if equal_bars:
        a1, a2 = _along_valleys(arm, x[owner], y[owner], a1, a2)
    a1, a2 = (2 * math.pi - (2 * math.pi - alpha) % _FULL_TURN for alpha in (a1, a2))  # into (-2 pi, 2 pi]
    a1, a2 = _onto_limits(arm, x[owner], y[owner], a1, a2)
    residual = evaluate(curve.distance, curve.geometry(arm), x[owner], y[owner], a1, a2)
    rounding = (_VALLEY if equal_bars else 1e-12) * arm.reach
    keep = (residual < rounding) & arm.is_within_limits((a1, a2))
    if arm.design.joint_limit <= math.pi:  # which leaves the flat poses out
        keep &= np.maximum(np.abs(a1), np.abs(a2)) < math.pi - 1e-9
    owner, a1, a2, residual = (values[keep] for values in (owner, a1, a2, residual))
    order = np.lexsort((residual, owner)) if equal_bars else order_within(owner, a1, a2)
    owner, a1, a2, residual = (values[order] for values in (owner, a1, a2, residual))
    if equal_bars:
        new = _leaders(arm, x, y, owner, a1, a2, residual)
    else:
        new = _new_solutions(arm, x, y, owner, a1, a2, residual)
    kept = np.flatnonzero(new)
    if equal_bars:
        kept = kept[order_within(owner[kept], a1[kept], a2[kept])]
    return owner[kept], (a1[kept], a2[kept]), residual[kept]


def _new_solutions(
    arm: TwoXKinematics,
    x: np.ndarray,
    y: np.ndarray,
    owner: np.ndarray,
    a1: np.ndarray,
    a2: np.ndarray,
    residual: np.ndarray,
) -> np.ndarray:
    """Which candidates are solutions of their own; others differ by rounding, sqrt(eps) at a double root."""
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


def _leaders(
    arm: TwoXKinematics,
    x: np.ndarray,
    y: np.ndarray,
    owner: np.ndarray,
    a1: np.ndarray,
    a2: np.ndarray,
    residual: np.ndarray,
) -> np.ndarray:
    """The same for nearly equal bars, whose solutions are long valleys; the best candidates come first.

    A candidate belongs to a better one where the tip, all the way between them along the valley's floor, is no
    further from the target than at the worse of the two, or than rounding.
    """
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
    arm: TwoXKinematics, x: np.ndarray, y: np.ndarray, a1: np.ndarray, a2: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Angles that rounding has carried beyond a joint limit, put onto it; the other joint makes up for it."""
    limit, beyond, stride = arm.design.joint_limit, _ROUNDING, 1e-3
    if arm._excess < _NEARLY_SINGULAR * arm.design.l**2:  # valleys along which the tip moves less than rounding
        beyond = stride = 0.3
        if limit == math.pi:
            limit -= 2e-9  # since a flat pose counts as none
    over = [np.abs(alpha) > limit for alpha in (a1, a2)]
    index = np.flatnonzero((over[0] | over[1]) & (np.maximum(np.abs(a1), np.abs(a2)) < limit + beyond))
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


def _polish(
    arm: TwoXKinematics, x: np.ndarray, y: np.ndarray, a1: np.ndarray, a2: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Damped Newton steps from every candidate to its target: the best point of each way.

    Steps that lead further away are taken back, and damped more: next to a singularity, where two solutions meet,
    full steps would run along the direction that moves the tip least.
    """
    a1, a2, damped = a1.copy(), a2.copy(), np.full(len(a1), 1e-3)
    active, geometry = np.arange(len(a1)), curve.geometry(arm)
    for _ in range(60 // curve.POLISHING_STEPS):
        if not len(active):
            break
        given = (x[active], y[active], a1[active], a2[active], damped[active])
        a1[active], a2[active], damped[active], going_on = evaluate(curve.polished, geometry, *given)
        active = active[going_on]
    return a1, a2


def _along_valleys(
    arm: TwoXKinematics, x: np.ndarray, y: np.ndarray, a1: np.ndarray, a2: np.ndarray
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


def _candidates(arm: TwoXKinematics, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A starting point close to every solution: index of the target, alpha_1, alpha_2.

    Seen from the base of joint 2, in its axes, the tip runs along a curve that has no square root in it: with d
    the tip's position, k = d.d - a^2 - l^2,

        (k + l^2) k + b^2 d_y^2 - 2 a (l^2 - b^2) d_y - a^2 (2 l^2 - b^2) = 0.

    An X-joint moves like two rolling ellipses; in their eccentric anomaly psi, tan(alpha/2) = sqrt(1 - b^2/l^2)
    tan(psi), r = sqrt(l^2 - b^2) / h, h^2 = cos^2(psi) + (1 - b^2/l^2) sin^2(psi). Times h^4 the curve's equation
    is therefore a trigonometric polynomial of order 4 in psi_1, known from a few samples: at most eight
    solutions, the real roots of a polynomial of degree eight. (Without offsets h^2 divides it; what is left is the
    quartic of [Furet2018, Eqs. 3-8] in another variable.)
    """
    a, l = arm.design.a, arm.design.l
    distance = np.maximum(np.abs(x), np.abs(y))
    if a == 0 and (distance < 1e-12 * l).any():
        raise ValueError("target (0, 0): the base, which every configuration with alpha_1 + alpha_2 = +-2 pi reaches")
    within = np.flatnonzero(distance <= arm.reach)
    x, y = x[within], y[within]
    flatness, geometry = arm._excess / (l * l), curve.geometry(arm)
    # The variable is t = tan(omega/2), with t = infinity where the sample is largest: no root is near infinity.
    top, polynomial = turned_product(evaluate(curve.samples, geometry, x, y), _SAMPLES_TO_POLYNOMIAL)
    owner, t = real_roots(polynomial)
    a1 = evaluate(curve.first_angle, geometry, top[owner] * (2 * math.pi / SAMPLES), t)
    # Ill-conditioned where the bars are nearly equal: all but the smallest angles have anomalies next to pi / 2.
    if flatness < _NEARLY_SINGULAR:
        more = _scanned(arm, x, y)
        owner, a1 = np.concatenate([owner, more[0]]), np.concatenate([a1, more[1]])
    a2, u, rc, rr = evaluate(curve.second_angle_of, geometry, x[owner], y[owner], a1)
    # Where the curve crosses itself (u = 0) a point of it belongs to both signs of alpha_2.
    node = np.flatnonzero(np.abs(u) < 1e-3 * l * l)
    fold = 2 * np.arccos(np.clip(rc[node] / np.sqrt(rr[node] + 1e-300), -1.0, 1.0))
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


def through_anomaly(
    arm: TwoXKinematics, x: Component, y: Component, psi: Component
) -> tuple[tuple[Component, Component], Component, Component]:
    """What the inverse kinematics looks for roots of, along the circle of joint 1's eccentric anomaly. Traceable.

    Returns:
        (alpha_1, alpha_2) [rad] with the tip at (x, y) [m] where the second result is 0; that result; and u, next
        to whose zeros [m2] alpha_2 has another solution.
    """
    alpha1 = from_anomaly(arm, psi)
    dx, dy, dd = beyond_joint_1(arm, x, y, alpha1)
    alpha2, u, _, _ = second_angle(arm, dx, dy, dd)
    return (alpha1, alpha2), off_curve(arm, dy, dd), u


def _scanned(arm: TwoXKinematics, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the target and alpha_1 of solutions, by even scans of the circle of alpha_1 and of its anomaly."""
    n = len(x)

    def off(line: np.ndarray, angle: np.ndarray) -> np.ndarray:
        a1 = np.where(line < n, 2 * angle, from_anomaly(arm, angle))
        _, dy, dd = beyond_joint_1(arm, x[line % n], y[line % n], a1)
        return np.asarray(off_curve(arm, dy, dd))

    if not n:
        return np.zeros(0, int), np.zeros(0)
    line, angle = circle_roots(off, 2 * n, 720, 1e-12)
    return line % n, np.where(line < n, 2 * angle, from_anomaly(arm, angle))


def furet_quartic(x: float, y: float, b: float) -> np.ndarray:
    """Coefficients a4 ... a0 of [Furet2018, Eqs. 4-8] in t = tan(phi_1/2), for L = 1.

    phi_1, which the paper does not define, is the orientation of the long bar from the left base pivot to the top
    right one.
    """
    xx, yy, bb = x * x, y * y, b * b
    rr = (xx + yy) ** 2
    return np.array(
        [
            (b + 1) ** 2 * (bb * yy + rr + 4 * x * (xx + yy) + 5 * xx + yy + 2 * x),
            4 * y * (b + 1) * (2 * bb * x + bb - 2 * xx - 2 * yy - 4 * x - 1),
            2 * (bb * bb * yy + bb * rr + bb * xx - 10 * bb * yy + rr - 3 * xx + 9 * yy),
            4 * y * (b - 1) * (2 * bb * x - bb + 2 * xx + 2 * yy - 4 * x + 1),
            (b - 1) ** 2 * (bb * yy + rr - 4 * x * (xx + yy) + 5 * xx + yy - 2 * x),
        ]
    )


def _angle_gap(first: Component, second: Component) -> Component:
    gap = np.abs(first - second) % _FULL_TURN
    return np.minimum(gap, _FULL_TURN - gap)
