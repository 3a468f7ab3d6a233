"""The curve on which joint 2 can reach a target, seen from joint 1: component code of the inverse kinematics.

The functions that take a `geometry` are for `compiler.kernel.evaluate`.
"""

import math

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.two_x.design import TwoXDesign
from tensegrity_envs.mechanics.two_x.kinematics import TwoXKinematics

SAMPLES = 16  # of the trigonometric polynomial of the inverse kinematics; 9 would determine it
POLISHING_STEPS = 2  # at once; one is enough for most


def geometry(arm: TwoXKinematics) -> TwoXDesign:
    """A design of the same bars, whose lengths are data of compiled code: no code is made for each design."""
    design: TwoXDesign = object.__new__(TwoXDesign)
    lengths = {name: np.array([getattr(arm.design, name)], float) for name in ("b", "l", "a")}
    vars(design).update(dict.fromkeys(vars(arm.design), 1.0) | lengths)
    return design


def off_curve(arm: TwoXKinematics, dy: Component, dd: Component) -> Component:
    """0 where joint 2 can reach the target; see `inverse._candidates`."""
    a, l, bb = arm.design.a, arm.design.l, arm._bb
    u = dd - a * a
    return u * (u - l * l) + bb * dy * dy - a * (2 * arm._excess * dy + a * (l * l + arm._excess))


def second_angle(
    arm: TwoXKinematics, dx: Component, dy: Component, dd: Component
) -> tuple[Component, Component, Component, Component]:
    """alpha_2 [rad] of a target on the curve, u = d.d - a^2, r cos(alpha_2/2) and r^2; see `inverse._candidates`."""
    xp = arm._xp(dx, dy, dd)
    a, l, bb = arm.design.a, arm.design.l, arm._bb
    u = dd - a * a
    rc = (a * (2 * (u - l * l) + bb) + bb * dy) / (bb + 4 * a * a)
    rr = xp.maximum(u - 2 * a * rc, 0.0)
    sign = xp.where(u > 0, 1.0, xp.where(u < 0, -1.0, 0.0))
    return 2 * xp.atan2(-rr * dx * sign, rc * abs(u)), u, rc, rr


def from_anomaly(arm: TwoXKinematics, psi: Component) -> Component:
    """The angle alpha [rad] at which the eccentric anomaly of a joint's rolling ellipses is psi."""
    xp = arm._xp(psi)
    return 2 * xp.atan2(xp.sqrt(arm._excess) / arm.design.l * xp.sin(psi), xp.cos(psi))


def beyond_joint_1(
    arm: TwoXKinematics, x: Component, y: Component, a1: Component
) -> tuple[Component, Component, Component]:
    """The target seen from the base of joint 2, in that base's axes, and its distance squared."""
    joint = arm._joint(arm._xp(x, y, a1), a1)
    sin, cos = 2 * joint.s * joint.c, joint.c**2 - joint.s**2
    dx = x + joint.r * joint.s + arm.design.a * sin
    dy = y - joint.r * joint.c - arm.design.a * cos
    return cos * dx + sin * dy, cos * dy - sin * dx, dx * dx + dy * dy


def samples(design: TwoXDesign, x: Component, y: Component) -> Components:
    """Of the trigonometric polynomial of `inverse._candidates`, at psi = 2 pi j / 16."""
    arm = TwoXKinematics(design)
    xp = arm._xp(x, y)
    found = []
    for j in range(SAMPLES):
        psi = j * (2 * math.pi / SAMPLES)
        hh = math.cos(psi) ** 2 + arm._excess / (design.l * design.l) * math.sin(psi) ** 2
        angle = 2 * xp.atan2(xp.sqrt(arm._excess) / design.l * math.sin(psi), math.cos(psi))
        _, dy, dd = beyond_joint_1(arm, x, y, angle)
        found.append(off_curve(arm, dy, dd) * (hh * hh))
    return tuple(found)


def first_angle(design: TwoXDesign, turned: Component, t: Component) -> Component:
    """alpha_1 [rad] of a root t of the polynomial whose variable is turned by that angle."""
    arm = TwoXKinematics(design)
    return from_anomaly(arm, turned + math.pi + 2 * arm._xp(t).atan2(t, 1.0))


def second_angle_of(design: TwoXDesign, x: Component, y: Component, a1: Component) -> tuple[Component, ...]:
    """Of the second joint, see `second_angle`."""
    arm = TwoXKinematics(design)
    return second_angle(arm, *beyond_joint_1(arm, x, y, a1))


def distance(design: TwoXDesign, x: Component, y: Component, a1: Component, a2: Component) -> Component:
    """Of the tip from (x, y) [m]."""
    arm = TwoXKinematics(design)
    px, py = arm.tip((a1, a2))
    return arm._xp(x).hypot(px - x, py - y)


def polished(
    design: TwoXDesign, x: Component, y: Component, a1: Component, a2: Component, damped: Component
) -> tuple[Component, Component, Component, Component]:
    """Some steps of `inverse._polish`: angles, their damping, and whether there are more steps to take."""
    arm = TwoXKinematics(design)
    xp, size = arm._xp(x, y, a1, a2), arm.reach
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
