"""The shortest way past a round obstacle, in the plane of two inputs."""

from typing import NamedTuple

from tensegrity_envs.compiler.namespace import Component, Components, namespace_of

_ROUNDING = 1e-6  # of angles [rad]: whoever has come to the corner is free to go on
_WIDEST = 1.0  # half of the angle about the obstacle that one corner takes, at most [rad]


class Disc(NamedTuple):
    """An obstacle: centre and radius."""

    x: float
    y: float
    radius: float


def shortest_path(start: Components, end: Components, disc: Disc) -> tuple[Component, Components]:
    """Length of the shortest way between two points that keeps out of a disc, and where to head for first. Traceable.

    That is straight, or a tangent, an arc and another tangent. Where a point lies within the disc, the disc shrinks
    until it does not.

    Args:
        start: (x, y).
        end: (x, y).
        disc: the obstacle.

    Returns:
        The length, and a point (x, y): the end, where the straight way is free, else where the two tangents meet,
        which lies before that where they would meet far away.
    """
    xp = namespace_of(*start, *end)
    px, py, sx, sy = start[0] - disc.x, start[1] - disc.y, end[0] - disc.x, end[1] - disc.y
    square_p, square_s = px * px + py * py, sx * sx + sy * sy
    far = xp.sqrt(square_p)  # not hypot, which takes several times as long
    r = xp.minimum(disc.radius, xp.minimum(far, xp.sqrt(square_s)))
    tangent_p = xp.sqrt(xp.maximum(square_p - r * r, 0.0))
    tangent_s = xp.sqrt(xp.maximum(square_s - r * r, 0.0))
    cross, dot = px * sy - py * sx, px * sx + py * sy
    # About the centre, from where one tangent touches to where the other does: the angle of (dot + i |cross|)
    # (r - i tangent_p) (r - i tangent_s). Negative: the straight way is free.
    re, im = dot * r + abs(cross) * tangent_p, abs(cross) * r - dot * tangent_p
    arc = xp.atan2(im * r - re * tangent_s, re * r + im * tangent_s)
    free = arc <= _ROUNDING
    straight = xp.sqrt((px - sx) ** 2 + (py - sy) ** 2)
    length = xp.where(free, straight, tangent_p + tangent_s + r * xp.maximum(arc, 0.0))
    # The corner: the direction of the start, turned to where its tangent touches and then by half of the arc. A start
    # at the centre has no direction, and takes any.
    half = xp.minimum(xp.maximum(arc, 0.0) / 2, _WIDEST)
    edge = xp.where(far > 0, xp.sqrt(r * r + tangent_p * tangent_p), 1.0)
    c = (r * xp.cos(half) - tangent_p * xp.sin(half)) / edge
    s = xp.where(cross < 0, -1.0, 1.0) * (tangent_p * xp.cos(half) + r * xp.sin(half)) / edge
    ux, uy = xp.where(far > 0, px, 1.0), xp.where(far > 0, py, 0.0)
    share = r / xp.cos(half) / xp.where(far > 0, far, 1.0)
    corner_x, corner_y = disc.x + share * (c * ux - s * uy), disc.y + share * (s * ux + c * uy)
    return length, (xp.where(free, end[0], corner_x), xp.where(free, end[1], corner_y))
