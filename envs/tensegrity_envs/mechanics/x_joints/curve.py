"""The curve on which a joint's offset ends, and the tip of two joints along it: component code.

Seen from the base of a joint, in its axes, the end of its offset runs along a curve that has no square root in it: with
d its position and u = d.d - a^2,

    u (u - l^2) + b^2 d_y^2 - 2 a (l^2 - b^2) d_y - a^2 (2 l^2 - b^2) = 0.

An X-joint moves like two rolling ellipses; in their eccentric anomaly psi, tan(alpha/2) = sqrt(1 - b^2/l^2) tan(psi)
and r = sqrt(l^2 - b^2) / h, h^2 = cos^2(psi) + (1 - b^2/l^2) sin^2(psi). Times h^4 of joint 1, the equation of joint
2's curve is therefore a trigonometric polynomial of order 4 in psi_1, known from a few samples.

The functions that take a `geometry` are for `compiler.kernel.evaluate`.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from tensegrity_envs.compiler.namespace import Component, Components, Namespace, namespace_of
from tensegrity_envs.mechanics.x_joints.joint import Bars

SAMPLES = 16  # of the trigonometric polynomial of the inverse kinematics; 9 would determine it
POLISHING_STEPS = 2  # at once; one is enough for most

# How an arm of two joints is made of a design, and a design of the same bars, whose lengths are data of compiled code:
# no code is made for each design.
Geometry = tuple[Callable[[Any], "Pair"], Any]


class Limited(Protocol):
    """A design with a joint limit."""

    @property
    def joint_limit(self) -> float:
        """|alpha| is at most this [rad]."""


class Pair(Protocol):
    """An arm of two X-joints."""

    @property
    def bars(self) -> Sequence[Bars]:
        """Of both joints."""

    @property
    def geometry(self) -> Geometry:
        """The same arm for compiled code."""

    @property
    def design(self) -> Limited:
        """Its parameters."""

    @property
    def reach(self) -> Component:
        """An upper bound of the tip's distance from the base [m]."""

    def tip(self, q: Components, /) -> tuple[Component, Component]:
        """Its position [m]."""

    def jacobian(self, q: Components, /) -> tuple[Components, Components]:
        """The rows dx / d alpha and dy / d alpha [m/rad]."""


def off_curve(bars: Bars, dy: Component, dd: Component) -> Component:
    """0 where the offset can end at a point, of which y and the square of the distance are given."""
    a, l, bb, excess = bars.a, bars.l, bars.b * bars.b, bars.excess
    u = dd - a * a
    return u * (u - l * l) + bb * dy * dy - a * (2 * excess * dy + a * (l * l + excess))


def angle_on_curve(
    bars: Bars, dx: Component, dy: Component, dd: Component
) -> tuple[Component, Component, Component, Component]:
    """alpha [rad] at a point on the curve, u = d.d - a^2, r cos(alpha/2) and r^2.

    Where the curve crosses itself (u = 0), another alpha belongs to the point, and minus that; see `pairs.crossings`.
    """
    xp = namespace_of(*bars, dx, dy, dd)
    a, l, bb = bars.a, bars.l, bars.b * bars.b
    u = dd - a * a
    rc = (a * (2 * (u - l * l) + bb) + bb * dy) / (bb + 4 * a * a)
    rr = xp.maximum(u - 2 * a * rc, 0.0)
    sign = xp.where(u > 0, 1.0, xp.where(u < 0, -1.0, 0.0))
    return 2 * xp.atan2(-rr * dx * sign, rc * abs(u)), u, rc, rr


def from_anomaly(bars: Bars, psi: Component) -> Component:
    """The angle alpha [rad] at which the eccentric anomaly of a joint's rolling ellipses is psi."""
    xp = namespace_of(*bars, psi)
    return 2 * xp.atan2(xp.sqrt(bars.excess) / bars.l * xp.sin(psi), xp.cos(psi))


def beyond(bars: Bars, x: Component, y: Component, alpha: Component) -> tuple[Component, Component, Component]:
    """A target seen from the base of the next joint, in that base's axes, and its distance squared."""
    xp = namespace_of(*bars, x, y, alpha)
    s, c = xp.sin(alpha / 2), xp.cos(alpha / 2)
    r = _midpoints(xp, bars, s)
    sin, cos = 2 * s * c, c**2 - s**2
    dx = x + r * s + bars.a * sin
    dy = y - r * c - bars.a * cos
    return cos * dx + sin * dy, cos * dy - sin * dx, dx * dx + dy * dy


def _midpoints(xp: Namespace, bars: Bars, s: Component) -> Component:
    """The distance of the midpoints of base and top bar [m], see `joint.joint_at`."""
    return xp.sqrt(bars.excess + bars.b * bars.b * s * s)


def samples(geometry: Geometry, x: Component, y: Component) -> Components:
    """Of the trigonometric polynomial of the module, at psi = 2 pi j / 16."""
    first, second = _arm(geometry).bars
    xp = namespace_of(*first, x, y)
    found = []
    for j in range(SAMPLES):
        psi = j * (2 * math.pi / SAMPLES)
        hh = math.cos(psi) ** 2 + first.flatness * math.sin(psi) ** 2
        angle = 2 * xp.atan2(xp.sqrt(first.excess) / first.l * math.sin(psi), math.cos(psi))
        _, dy, dd = beyond(first, x, y, angle)
        found.append(off_curve(second, dy, dd) * (hh * hh))
    return tuple(found)


def first_angle(geometry: Geometry, turned: Component, t: Component) -> Component:
    """alpha_1 [rad] of a root t of the polynomial whose variable is turned by that angle."""
    return from_anomaly(_arm(geometry).bars[0], turned + math.pi + 2 * namespace_of(t).atan2(t, 1.0))


def second_angle(geometry: Geometry, x: Component, y: Component, a1: Component) -> tuple[Component, ...]:
    """Of the second joint with the tip at a target, see `angle_on_curve`."""
    first, second = _arm(geometry).bars
    return angle_on_curve(second, *beyond(first, x, y, a1))


def distance(geometry: Geometry, x: Component, y: Component, a1: Component, a2: Component) -> Component:
    """Of the tip from (x, y) [m]."""
    px, py = _arm(geometry).tip((a1, a2))
    return namespace_of(px).hypot(px - x, py - y)


def _arm(geometry: Geometry) -> Pair:
    make, design = geometry
    return make(design)


def polished(
    geometry: Geometry, x: Component, y: Component, a1: Component, a2: Component, damped: Component
) -> tuple[Component, Component, Component, Component]:
    """Some steps of `pairs._polish`: angles, their damping, and whether there are more steps to take."""
    arm = _arm(geometry)
    xp, size = namespace_of(x, y, a1, a2), arm.reach
    px, py = arm.tip((a1, a2))
    ex, ey = px - x, py - y
    square, going_on = ex * ex + ey * ey, damped > 0
    for _ in range(POLISHING_STEPS):
        (xa, xb), (ya, yb) = arm.jacobian((a1, a2))
        # Levenberg's damping, quadratically small in the error: Newton's speed, yet finite steps where det J is 0.
        damping = damped * square / (size * size)
        m11, m12, m22 = xa * xa + ya * ya + damping, xa * xb + ya * yb, xb * xb + yb * yb + damping
        v1, v2 = xa * ex + ya * ey, xb * ex + yb * ey
        det = xa * yb - xb * ya
        det = det * det + damping * (m11 + m22 - damping) + 1e-300
        step1, step2 = (m22 * v1 - m12 * v2) / det, (m11 * v2 - m12 * v1) / det
        length = xp.hypot(step1, step2)
        shrink = 0.3 / xp.maximum(0.3, length)
        new1, new2 = a1 - shrink * step1, a2 - shrink * step2
        px, py = arm.tip((new1, new2))
        dx, dy = px - x, py - y
        there = dx * dx + dy * dy
        better = (there <= square) & going_on
        a1, a2 = xp.where(better, new1, a1), xp.where(better, new2, a2)
        ex, ey, square = xp.where(better, dx, ex), xp.where(better, dy, ey), xp.where(better, there, square)
        damped = xp.where(going_on, xp.maximum(damped * xp.where(better, 0.1, 100.0), 1e-3), damped)
        going_on = going_on & (length > 1e-11) & (square > 0) & (damped < 1e40)
    return a1, a2, damped, going_on
