"""Kinematics and potential energy of the chain, with gradient and Hessian, on components. Derived in docs/n_x.md.

phi_i is the orientation of the base bar of joint i, theta_i = phi_i + alpha_i / 2 that of the line between its
midpoints. The chain is a sum of vectors r_i e(theta_i) + a_i e(phi_i+1), e(x) = (-sin x, cos x), and the energy without
springs and cables a sum of r_i p_i(theta_i) + o_i(phi_i+1), where p and o are combinations of a sine and a cosine.
"""

from collections.abc import Sequence
from typing import NamedTuple

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.x_joints.joint import Joint


class Turn(NamedTuple):
    """Sine and cosine of theta_i and of phi_i+1."""

    middle_s: Component
    middle_c: Component
    end_s: Component
    end_c: Component


class Weights(NamedTuple):
    """What the energy of gravity depends on, for each joint [N] and, the last one, [N m].

    Attributes:
        joint: weight that the vector from base to top of the joint lifts.
        offset: weight that the offset's vector lifts.
        lateral: moment of the offset's truss about its middle line; zero where neighbours have equal b.
    """

    joint: Components
    offset: Components
    lateral: Components


def turns(joints: Sequence[Joint]) -> list[Turn]:
    """The directions of all vectors of the chain, by addition of angles."""
    found: list[Turn] = []
    for joint in joints:
        s, c = joint.s, joint.c
        if found:
            before_s, before_c = found[-1].end_s, found[-1].end_c
            middle_s, middle_c = before_s * c + before_c * s, before_c * c - before_s * s
            found.append(Turn(middle_s, middle_c, middle_s * c + middle_c * s, middle_c * c - middle_s * s))
        else:
            found.append(Turn(s, c, 2 * s * c, c * c - s * s))
    return found


def tip(joints: Sequence[Joint], directions: Sequence[Turn], offsets: Components) -> tuple[Component, Component]:
    """Position of the tip [m]."""
    x: Component = 0.0
    y: Component = 0.0
    for joint, turn, a in zip(joints, directions, offsets, strict=True):
        x = x - (joint.r * turn.middle_s + a * turn.end_s)
        y = y + (joint.r * turn.middle_c + a * turn.end_c)
    return x, y


def jacobian(joints: Sequence[Joint], directions: Sequence[Turn], offsets: Components) -> tuple[Components, Components]:
    """d tip / d alpha [m/rad]: the row of x, the row of y."""
    x_row: list[Component] = []
    y_row: list[Component] = []
    x: Component = 0.0  # from the end of the joint to the tip
    y: Component = 0.0
    for joint, turn, a in zip(reversed(joints), reversed(directions), reversed(offsets), strict=True):
        x, y = x - a * turn.end_s, y + a * turn.end_c
        half = joint.r / 2
        x_row.append(-(joint.dr * turn.middle_s + half * turn.middle_c + y))
        y_row.append(joint.dr * turn.middle_c - half * turn.middle_s + x)
        x, y = x - joint.r * turn.middle_s, y + joint.r * turn.middle_c
    return tuple(reversed(x_row)), tuple(reversed(y_row))


def energy(
    joints: Sequence[Joint],
    directions: Sequence[Turn],
    offsets: Components,
    weights: Weights,
    load: Sequence[Component],
) -> Component:
    """Energy of gravity and load [J]."""
    fx, fy = load
    total: Component = 0.0
    for i, (joint, turn, a) in enumerate(zip(joints, directions, offsets, strict=True)):
        total = total + joint.r * (fx * turn.middle_s + (weights.joint[i] - fy) * turn.middle_c)
        total = total + (a * fx + weights.lateral[i]) * turn.end_s + a * (weights.offset[i] - fy) * turn.end_c
    return total


def derivatives(
    joints: Sequence[Joint],
    directions: Sequence[Turn],
    offsets: Components,
    weights: Weights,
    load: Sequence[Component] | None,
) -> tuple[list[Component], list[list[Component]]]:
    """Gradient [N m] and Hessian [N m/rad] of the energy of gravity and load; the Hessian's upper triangle is filled.

    With P = sum of r_j p_j + o_j and D = sum of r_j p_j' + o_j' over what lies beyond joint k,

        g_k = r_k' p_k + r_k p_k' / 2 + o_k' + D,
        h_kk = (r_k'' - r_k / 4) p_k + r_k' p_k' - o_k - P,   h_ik = r_k' p_k' - r_k p_k / 2 - o_k - P  (i < k).
    """
    n = len(joints)
    gradient: list[Component] = [0.0] * n
    hessian: list[list[Component]] = [[0.0] * n for _ in range(n)]
    beyond_p: Component = 0.0
    beyond_d: Component = 0.0
    for k in reversed(range(n)):
        joint, turn, a = joints[k], directions[k], offsets[k]
        w, v, lateral = weights.joint[k], a * weights.offset[k], weights.lateral[k]
        if load is None:
            p, d = w * turn.middle_c, -w * turn.middle_s
            o, od = lateral * turn.end_s + v * turn.end_c, lateral * turn.end_c - v * turn.end_s
        else:
            fx, fy = load
            w, v, lateral = w - fy, v - a * fy, lateral + a * fx
            p, d = fx * turn.middle_s + w * turn.middle_c, fx * turn.middle_c - w * turn.middle_s
            o, od = lateral * turn.end_s + v * turn.end_c, lateral * turn.end_c - v * turn.end_s
        rp, rd, stretch = joint.r * p, joint.r * d, joint.dr * d
        beyond_p, beyond_d = beyond_p + o, beyond_d + od
        gradient[k] = joint.dr * p + rd / 2 + beyond_d
        hessian[k][k] = (joint.ddr - joint.r / 4) * p + stretch - beyond_p
        mixed = stretch - rp / 2 - beyond_p
        for i in range(k):
            hessian[i][k] = mixed
        beyond_p, beyond_d = beyond_p + rp, beyond_d + rd
    return gradient, hessian
