"""All configurations of two X-joints, equal or not, whose tip is at a target: the roots of one polynomial each.

Seen from the base of joint 2, in its axes, the tip runs along a curve without square roots: with d its position and
u = d.d - a^2,

    u (u - l^2) + b^2 d_y^2 - 2 a (l^2 - b^2) d_y - a^2 (2 l^2 - b^2) = 0      (b, l, a of joint 2).

Joint 1 moves like two rolling ellipses, rationally in their eccentric anomaly psi: tan(alpha/2) = sqrt(1 - b^2/l^2)
tan(psi), r = sqrt(l^2 - b^2) / h, h^2 = cos^2(psi) + (1 - b^2/l^2) sin^2(psi) (b, l of joint 1). Times h^4 the curve's
equation is a trigonometric polynomial of order 4 in psi. `TwoX.inverse_kinematics` is the case of equal joints.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.polynomials import product, real_roots

_SAMPLES = 16  # of the trigonometric polynomial; 9 would determine it
_NEARLY_FLAT = 2e-3  # 1 - (b/l)^2, where the polynomial is not enough
_GRID = 25  # starts along each joint, for nearly equal bars
_FULL_TURN = 4 * math.pi  # of alpha, since alpha / 2 runs once around

# (alpha_1, alpha_2) -> position of the tip, and its derivatives: ((dx/da1, dx/da2), (dy/da1, dy/da2))
Tip = Callable[[Sequence[Component]], tuple[Component, Component]]
Jacobian = Callable[[Sequence[Component]], tuple[Components, Components]]


class Lengths(NamedTuple):
    """A joint with its offset [m]."""

    b: float
    l: float
    a: float

    @property
    def excess(self) -> float:
        """l^2 - b^2 [m2]."""
        return (self.l - self.b) * (self.l + self.b)

    @property
    def flatness(self) -> float:
        """1 - (b / l)^2."""
        return self.excess / self.l**2

    def end(self, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position of the offset's end [m], from the base of the joint."""
        s, c = np.sin(alpha / 2), np.cos(alpha / 2)
        r = np.sqrt(self.excess + (self.b * s) ** 2)
        return -r * s - 2 * self.a * s * c, r * c + self.a * (c * c - s * s)

    def from_anomaly(self, psi: np.ndarray) -> np.ndarray:
        """The angle alpha [rad] at an eccentric anomaly."""
        return np.asarray(2 * np.arctan2(math.sqrt(self.excess) / self.l * np.sin(psi), np.cos(psi)))

    def off_curve(self, dy: np.ndarray, dd: np.ndarray) -> np.ndarray:
        """0 where the end can be at a point whose y and square of the distance are given."""
        u = dd - self.a**2
        tail = self.a * (2 * self.excess * dy + self.a * (self.l**2 + self.excess))
        return np.asarray(u * (u - self.l**2) + (self.b * dy) ** 2 - tail)

    def angles_at(self, dx: np.ndarray, dy: np.ndarray, dd: np.ndarray) -> list[np.ndarray]:
        """alpha [rad] of points on the curve, and of both signs where the curve crosses itself (u = 0)."""
        bb, u = self.b**2, dd - self.a**2
        rc = (self.a * (2 * (u - self.l**2) + bb) + bb * dy) / (bb + 4 * self.a**2)  # r cos(alpha/2)
        rr = np.maximum(u - 2 * self.a * rc, 0.0)
        fold = 2 * np.arccos(np.clip(rc / np.sqrt(rr + 1e-300), -1.0, 1.0))
        fold = np.where(np.abs(u) < 1e-3 * self.l**2, fold, np.nan)
        return [2 * np.arctan2(-rr * dx * np.sign(u), rc * np.abs(u)), fold, -fold]


def beyond(first: Lengths, x: np.ndarray, y: np.ndarray, alpha: np.ndarray) -> tuple[np.ndarray, ...]:
    """A target seen from the base of the next joint, in that base's axes, and its distance squared."""
    px, py = first.end(alpha)
    dx, dy = x - px, y - py
    sin, cos = np.sin(alpha), np.cos(alpha)
    return cos * dx + sin * dy, cos * dy - sin * dx, dx * dx + dy * dy


def _samples_to_polynomial() -> np.ndarray:
    """From samples at pi + 2 pi j / 16 to p_0 ... p_8: the polynomial is (p_0 + ... + p_8 t^8) / (1 + t^2)^4."""
    half = (math.pi + np.arange(_SAMPLES) * (2 * math.pi / _SAMPLES)) / 2
    power = np.arange(9)
    return np.linalg.pinv(np.sin(half)[:, None] ** power * np.cos(half)[:, None] ** (8 - power)).T


_SAMPLES_TO_POLYNOMIAL = _samples_to_polynomial()


def _candidates(
    first: Lengths, second: Lengths, x: np.ndarray, y: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A starting point close to every solution: index of the target, alpha_1, alpha_2."""
    psi = np.arange(_SAMPLES) * (2 * math.pi / _SAMPLES)
    hh = np.cos(psi) ** 2 + first.flatness * np.sin(psi) ** 2
    _, dy, dd = beyond(first, x[:, None], y[:, None], first.from_anomaly(psi))
    samples = second.off_curve(dy, dd) * (hh * hh)
    # The variable is t = tan(omega/2), with t = infinity where the sample is largest: no root is near infinity.
    top = np.abs(samples).argmax(axis=1)
    turned = samples[np.arange(len(x))[:, None], (top[:, None] + np.arange(_SAMPLES)) % _SAMPLES]
    owner, t = real_roots(product(turned, _SAMPLES_TO_POLYNOMIAL))
    a1 = first.from_anomaly(psi[top[owner]] + math.pi + 2 * np.arctan(t))
    seconds = second.angles_at(*beyond(first, x[owner], y[owner], a1))
    owner, a1, a2 = np.tile(owner, 3), np.tile(a1, 3), np.concatenate(seconds)
    known = np.isfinite(a2)
    owner, a1, a2 = owner[known], a1[known], a2[known]
    if min(first.flatness, second.flatness) < _NEARLY_FLAT:
        axis = np.linspace(-limit, limit, _GRID)
        grid = [part.ravel() for part in np.meshgrid(axis, axis)]
        owner = np.concatenate([owner, np.repeat(np.arange(len(x)), _GRID**2)])
        a1, a2 = (np.concatenate([a, np.tile(part, len(x))]) for a, part in zip((a1, a2), grid, strict=True))
    return owner, a1, a2


def _polish(
    tip: Tip, jacobian: Jacobian, x: np.ndarray, y: np.ndarray, q: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """Damped Newton steps to the targets; the best point of each way, and its distance from the target."""
    q = q.copy()
    px, py = tip(tuple(q))
    e = np.stack([px - x, py - y])
    square, damped = (e * e).sum(axis=0), np.full(len(x), 1e-3)
    active = np.arange(len(x))
    for _ in range(60):
        if not len(active):
            break
        point = q[:, active]
        (xa, xb), (ya, yb) = jacobian(tuple(point))
        ux, uy = e[:, active]
        # Levenberg's damping, quadratically small in the error: Newton's speed, yet finite steps where det J is 0.
        damping = damped[active] * square[active] / size**2
        m11, m12, m22 = xa * xa + ya * ya + damping, xa * xb + ya * yb, xb * xb + yb * yb + damping
        v1, v2 = xa * ux + ya * uy, xb * ux + yb * uy
        det = xa * yb - xb * ya
        det = det * det + damping * (m11 + m22 - damping) + 1e-300
        step = np.stack([m22 * v1 - m12 * v2, m11 * v2 - m12 * v1]) / det
        length = np.hypot(*step)
        new = point - step * (0.3 / np.maximum(0.3, length))
        px, py = tip(tuple(new))
        error = np.stack([px - x[active], py - y[active]])
        there = (error * error).sum(axis=0)
        better = there <= square[active]
        done = active[better]
        q[:, done], e[:, done], square[done] = new[:, better], error[:, better], there[better]
        damped[active] = np.maximum(damped[active] * np.where(better, 0.1, 100.0), 1e-3)
        active = active[(length > 1e-11) & (square[active] > 0) & (damped[active] < 1e40)]
    return q, np.sqrt(square)


def solve_pair(
    first: Lengths, second: Lengths, tip: Tip, jacobian: Jacobian, x: np.ndarray, y: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All configurations within the limits with the tip at the targets.

    Args:
        first, second: the joints.
        tip, jacobian: of the pair.
        x, y: targets [m], shape (m,).
        limit: |alpha| is at most this [rad].

    Returns:
        Index of the target, shape (k,), configurations, shape (2, k), sorted by target and configuration, and their
        distances from the targets [m], shape (k,).
    """
    size = first.l + first.a + second.l + second.a
    within = np.flatnonzero(np.hypot(x, y) <= size)
    owner, a1, a2 = _candidates(first, second, x[within], y[within], limit)
    owner = within[owner]
    near = np.maximum(np.abs(a1), np.abs(a2)) < limit + 0.1
    owner, q = owner[near], np.stack([a1[near], a2[near]])
    q, residual = _polish(tip, jacobian, x[owner], y[owner], q, size)
    q = 2 * math.pi - (2 * math.pi - q) % _FULL_TURN  # into (-2 pi, 2 pi]
    keep = (residual < 1e-12 * size) & (np.abs(q) <= limit).all(axis=0)
    if limit <= math.pi:  # which leaves the flat poses out
        keep &= (np.abs(q) < math.pi - 1e-9).all(axis=0)
    owner, q, residual = owner[keep], q[:, keep], residual[keep]
    order = np.lexsort((residual, owner))
    owner, q, residual = owner[order], q[:, order], residual[order]
    new = np.ones(len(owner), bool)
    for lag in range(1, len(owner)):
        same = owner[lag:] == owner[:-lag]
        if not same.any():
            break
        gap = np.abs(q[:, lag:] - q[:, :-lag]) % _FULL_TURN
        new[lag:] &= ~(same & (np.minimum(gap, _FULL_TURN - gap).sum(axis=0) < 1e-6))
    owner, q, residual = owner[new], q[:, new], residual[new]
    order = np.lexsort((q[1], q[0], owner))
    return owner[order], q[:, order], residual[order]
