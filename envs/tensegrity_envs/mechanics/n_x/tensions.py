"""The stiffest and the softest tensions that hold a posture, in closed form, and how far it is from wrench-infeasible.

A joint's cables pull with the sums F_left and F_right on its sides, and hold it where F_left left - F_right right =
moment, moment = 2 r g / (b cos(alpha/2)), g the gradient of all other energy. Along this line, (F_left, F_right) =
(moment / left, 0) + t (right, left), the Hessian's diagonal grows by t (b cos(alpha/2))^2 (l^2 - b^2) / (2 r^2), and no
other entry changes. With cables of each joint alone the numbers t are independent of one another; with cables from the
base they are bounded by inequalities of two of them, with coefficients of opposite signs, whose solutions have one that
is greatest, and one that is least, in every component: they are eliminated from the base to the tip.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from tensegrity_envs.compiler.namespace import Component, Components, Namespace
from tensegrity_envs.mechanics.n_x.routing import Routing
from tensegrity_envs.mechanics.n_x.zonotope import largest_lower_bound
from tensegrity_envs.mechanics.x_joints.joint import Joint

_FAR = 1e100  # [-] further than any t


class Held(NamedTuple):
    """What holds a joint: its sides [m], and the moment F_left left - F_right right that the cables must give [N m].

    The moment is that in alpha times 2 r / (b cos(alpha/2)): it grows without bound close to the flat poses.
    """

    left: Component
    right: Component
    moment: Component


def held(xp: Namespace, joint: Joint, gradient: Component) -> Held:
    """The condition of a joint whose passive gradient is given."""
    left, right = joint.sides(xp)
    return Held(left, right, 2 * joint.r * gradient / (joint.b * joint.c))


def effective(routing: Routing, tensions: Sequence[Component]) -> list[tuple[Component, Component]]:
    """F_left and F_right [N] of every joint."""
    sums = []
    for j in range(len(routing[0])):
        pair = []
        for side in (-1, 1):
            pulling = [tension for tension, row in zip(tensions, routing, strict=True) if row[j] == side]
            total: Component = pulling[0] if pulling else 0.0
            for tension in pulling[1:]:
                total = total + tension
            pair.append(total)
        sums.append((pair[0], pair[1]))
    return sums


def moment_table(routing: Routing, joints: Sequence[Held]) -> list[list[Component | None]]:
    """What a unit of each cable's tension gives to the moments of `Held`."""
    table: list[list[Component | None]] = []
    for j, joint in enumerate(joints):
        effect = {-1: joint.left, 1: -joint.right, 0: None}
        table.append([effect[row[j]] for row in routing])
    return table


def others_at_bound(joint: Held, bound: Component) -> tuple[Component, Component]:
    """F_right with F_left at the bound, and F_left with F_right at it."""
    return (bound * joint.left - joint.moment) / joint.right, (bound * joint.right + joint.moment) / joint.left


def _joint_at_bound(
    xp: Namespace, joint: Held, bound: Component, is_upper: bool
) -> tuple[Component, Component, Component]:
    """F_left and F_right with one of them at the bound and the other one inside it, and that other one."""
    other_right, other_left = others_at_bound(joint, bound)
    left_at_bound = other_right <= bound if is_upper else other_right >= bound
    return (
        xp.where(left_at_bound, bound, other_left),
        xp.where(left_at_bound, other_right, bound),
        xp.where(left_at_bound, other_right, other_left),
    )


def per_joint(
    xp: Namespace, joints: Sequence[Held], low: Component, high: Component, stiffest: bool
) -> tuple[list[Component], Component]:
    """Tensions of two cables for each joint with one at its bound, the other not clipped; and the wrench margin [N]."""
    tensions: list[Component] = []
    least: Component = None
    for joint in joints:
        left, right, other = _joint_at_bound(xp, joint, high if stiffest else low, stiffest)
        tensions += [left, right]
        room = other - low if stiffest else high - other
        least = room if least is None else xp.minimum(least, room)
    return tensions, least


def from_base(
    xp: Namespace, routing: Routing, joints: Sequence[Held], low: Component, high: Component, stiffest: bool
) -> tuple[list[Component], Component]:
    """The same with cables that span all joints from the base to their own.

    Where no tensions within the bounds hold the posture, the lower bound is lowered until some do.
    """
    room = largest_lower_bound(xp, moment_table(routing, joints), tuple(joint.moment for joint in joints), high) - low
    bottom = low + xp.minimum(room, 0.0)
    n = len(joints)
    start = [(joint.moment / joint.left, 0.0) for joint in joints]
    slope = [(joint.right, joint.left) for joint in joints]
    # t_j lies between lower_j + ratio_j t_j+1 and upper_j + ratio_j t_j+1, for both sides
    lower, upper, ratio = [], [], []
    for j in range(n - 1):
        gap = [start[j + 1][side] - start[j][side] for side in (0, 1)]
        lower.append([(bottom + gap[side]) / slope[j][side] for side in (0, 1)])
        upper.append([(high + gap[side]) / slope[j][side] for side in (0, 1)])
        ratio.append([slope[j + 1][side] / slope[j][side] for side in (0, 1)])
    zero = 0.0 * joints[0].moment
    least, most = [zero - _FAR], [zero + _FAR]
    for j in range(n - 1):
        most_next, least_next = zero + _FAR, zero - _FAR
        for side in (0, 1):
            other = 1 - side
            most_next = xp.minimum(most_next, (most[j] - lower[j][side]) / ratio[j][side])
            least_next = xp.maximum(least_next, (least[j] - upper[j][side]) / ratio[j][side])
            # lower of this side <= upper of the other: steeper * t_j+1 <= slack
            steeper, slack = ratio[j][side] - ratio[j][other], upper[j][other] - lower[j][side]
            quotient = slack / xp.where(steeper == 0, 1.0, steeper)
            most_next = xp.where(steeper > 0, xp.minimum(most_next, quotient), most_next)
            least_next = xp.where(steeper < 0, xp.maximum(least_next, quotient), least_next)
        most.append(most_next)
        least.append(least_next)
    for side in (0, 1):
        most[-1] = xp.minimum(most[-1], (high - start[-1][side]) / slope[-1][side])
        least[-1] = xp.maximum(least[-1], (bottom - start[-1][side]) / slope[-1][side])
    t = most[-1] if stiffest else least[-1]
    sums = [(start[-1][0] + t * slope[-1][0], start[-1][1] + t * slope[-1][1])]
    for j in reversed(range(n - 1)):
        if stiffest:
            t = xp.minimum(most[j], xp.minimum(*(upper[j][side] + ratio[j][side] * t for side in (0, 1))))
        else:
            t = xp.maximum(least[j], xp.maximum(*(lower[j][side] + ratio[j][side] * t for side in (0, 1))))
        sums.insert(0, (start[j][0] + t * slope[j][0], start[j][1] + t * slope[j][1]))
    sums.append((0.0, 0.0))
    tensions: list[Component] = []
    for here, beyond in pairwise(sums):
        tensions += [here[0] - beyond[0], here[1] - beyond[1]]
    return tensions, room


def stiffness_of_cables(joints: Sequence[Joint], sums: Sequence[tuple[Component, Component]]) -> Components:
    """What the cables add to the diagonal of the Hessian [N m/rad]."""
    added = []
    for joint, (left, right) in zip(joints, sums, strict=True):
        of_left, of_right = joint.curvatures
        added.append(left * of_left + right * of_right)
    return tuple(added)
