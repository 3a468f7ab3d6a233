"""All configurations of a three-segment arm with its tip at one point: closed curves, smoothly parametrized.

With D, psi the target's polar coordinates about pivot 1, w = q1 - psi, l the long links and b2 the last one, the
distance rho of the target from pivot 2 is rho^2 = D^2 + l^2 - 2 D l cos w. The last two links reach it where
b1 = l - b2 <= rho <= l + b2: for w between -w_hi and w_hi (D >= l + b1), for w_lo <= |w| <= w_hi (D between), or for
every w (D <= b2). At the ends of these intervals the elbow (the sign of q3) changes; as a function of w the
configuration has a square root there. With w = w_hi cos s (or mid + half cos s) and the elbow sign(sin s) it has none:
cos w - cos w_hi, the argument of the root, is a product that contains sin^2 s, and is computed as one.
"""

import math
from dataclasses import dataclass

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components

SINGLE, PAIR, ROUND = "single", "pair", "round"


@dataclass
class SelfMotion:
    """The self-motion curves of m targets of one kind.

    A point of a curve is (loop, s): s in [0, 2 pi); `SINGLE` is one closed curve (loop 0), `PAIR` has two, mirror
    images of each other in the line from pivot 1 to the target, `ROUND` two, on which q1 turns all around.
    """

    kind: str
    distance: np.ndarray  # of the target from pivot 1 [m], shape (m,)
    direction: np.ndarray  # psi [rad]
    long: float
    short: float

    def __post_init__(self) -> None:
        """What evaluation needs of every target."""
        d, l1, far, near = self.distance, self.long, self.long + self.short, self.long - self.short
        self._scale = 4 * d * l1
        self.w_hi = np.full_like(d, math.pi) if self.kind == ROUND else _angle_at(d, l1, far)
        self.w_lo = _angle_at(d, l1, near) if self.kind == PAIR else np.zeros_like(d)
        self._a0 = np.maximum((far - d - l1) * (far + d + l1), 0.0)
        self._b0 = np.maximum((abs(d - l1) - near) * (abs(d - l1) + near), 0.0)

    def at(self, owner: Component, loop: Component, s: Component) -> Components:
        """The configuration at (loop, s) of target `owner`; arrays that broadcast. Angles in (-pi, pi]."""
        d, psi, scale = self.distance[owner], self.direction[owner], self._scale[owner]
        l1, l2, l3 = self.long, self.long, self.short
        if self.kind == ROUND:
            w = s - math.pi
            sin, cos = np.sin(w / 2), np.cos(w / 2)
            stretch = self._a0[owner] + scale * cos * cos
            folding = self._b0[owner] + scale * sin * sin
            elbow = 1.0 - 2.0 * loop
        else:
            sin_s, cos_s = np.sin(s / 2), np.cos(s / 2)
            elbow = np.sign(sin_s * cos_s)
            w_hi = self.w_hi[owner]
            if self.kind == SINGLE:
                w = w_hi * ((cos_s - sin_s) * (cos_s + sin_s))
                sin, cos = np.sin(w / 2), np.cos(w / 2)
                stretch = scale * np.sin(w_hi * sin_s * sin_s) * np.sin(w_hi * cos_s * cos_s)
                folding = self._b0[owner] + scale * sin * sin
            else:
                w_lo = self.w_lo[owner]
                half = (w_hi - w_lo) / 2
                e, f = half * sin_s * sin_s, half * cos_s * cos_s
                w = (1.0 - 2.0 * loop) * (w_lo + 2 * f)
                sin, cos = np.sin(w / 2), np.cos(w / 2)
                stretch = scale * np.sin(e) * np.sin(w_hi - e)
                folding = scale * np.sin(f) * np.sin(w_lo + f)
        root_a, root_b = elbow * np.sqrt(stretch), np.sqrt(folding)
        total = 4 * l2 * l3  # = stretch + folding
        gx, gy = l2 + l3 * (folding - stretch) / total, 2 * l3 * root_a * root_b / total
        # the target seen from pivot 2, in the axes of link 1
        dx, dy = d * (cos - sin) * (cos + sin) - l1, -2 * d * sin * cos
        q1 = psi + w
        q1 = np.where(q1 > math.pi, q1 - 2 * math.pi, np.where(q1 <= -math.pi, q1 + 2 * math.pi, q1))
        return q1, np.arctan2(dy * gx - dx * gy, dx * gx + dy * gy), 2 * np.arctan2(root_a, root_b)

    def grid(self, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Samples of the curves of a target: loop, s, and the indices of the previous and of the next sample.

        `points` is even. A single curve gets all of them, two curves get half each.
        """
        index = np.arange(points)
        if self.kind == SINGLE:
            return np.zeros(points), index * (2 * math.pi / points), (index - 1) % points, (index + 1) % points
        half = points // 2
        loop, place = index // half, index % half
        first = loop * half
        return (
            loop.astype(float),
            place * (2 * math.pi / half),
            first + (place - 1) % half,
            first + (place + 1) % half,
        )


def _angle_at(d: np.ndarray, l1: float, rho: float) -> np.ndarray:
    """The angle between sides d and l1 of a triangle whose third side is rho, accurate for flat triangles."""
    return np.asarray(
        2
        * np.arctan2(
            np.sqrt(np.maximum((rho - d + l1) * (rho + d - l1), 0.0)),
            np.sqrt(np.maximum((d + l1 - rho) * (d + l1 + rho), 0.0)),
        )
    )


def self_motions(
    x: np.ndarray, y: np.ndarray, pivot: float, long: float, short: float
) -> list[tuple[np.ndarray, SelfMotion]]:
    """The curves of targets (x, y) [m], shape (n,), by kind: indices of the targets, and their curves.

    Targets that the arm cannot reach at any angles belong to none.
    """
    distance, direction = np.hypot(x - pivot, y), np.arctan2(y, x - pivot)
    within = distance <= (2 * long + short) * (1 + 1e-15)
    kinds = np.where(distance <= short, 2, np.where(distance < 2 * long - short, 1, 0))
    groups = []
    for number, kind in enumerate((SINGLE, PAIR, ROUND)):
        index = np.flatnonzero(within & (kinds == number))
        if len(index):
            groups.append((index, SelfMotion(kind, distance[index], direction[index], long, short)))
    return groups


def with_one_angle(
    x: np.ndarray, y: np.ndarray, pivot: float, long: float, short: float, joint: int, value: np.ndarray
) -> list[tuple[Components, np.ndarray]]:
    """The (up to two) configurations of every target with one angle given: closed form, two links.

    Args:
        x: targets [m], any shape.
        y: targets [m].
        pivot: x of pivot 1 [m].
        long: length of links 1 and 2 [m].
        short: length of link 3 [m].
        joint: 0, 1 or 2.
        value: its angle [rad]; broadcasts against x.

    Returns:
        Two configurations, angles in (-pi, pi] besides the given one, and whether each exists.
    """
    u, v = x - pivot, y
    first: Component = long
    second: Component = short
    offset: Component = 0.0
    if joint == 0:
        u, v = u - long * np.cos(value), v - long * np.sin(value)
    elif joint == 1:
        first = np.hypot(long + long * np.cos(value), long * np.sin(value))
        offset = value / 2
    else:
        second = np.hypot(long + short * np.cos(value), short * np.sin(value))
        offset = np.arctan2(short * np.sin(value), long + short * np.cos(value))
    d, psi = np.hypot(u, v), np.arctan2(v, u)
    stretch = (first + second - d) * (first + second + d)
    folding = (d - first + second) * (d + first - second)
    slop = 1e-13 * (first + second) ** 2
    exists = (stretch >= -slop) & (folding >= -slop)
    bend = 2 * np.arctan2(np.sqrt(np.maximum(stretch, 0.0)), np.sqrt(np.maximum(folding, 0.0)))
    turn = np.arctan2(second * np.sin(bend), first + second * np.cos(bend))
    solutions: list[tuple[Components, np.ndarray]] = []
    for sign in (1.0, -1.0):
        head, elbow = psi - sign * turn, sign * bend
        if joint == 0:
            q = value + 0 * head, _wrap(head - value), elbow
        elif joint == 1:
            q = _wrap(head - offset), value + 0 * head, _wrap(elbow - value + offset)
        else:
            q = _wrap(head), _wrap(elbow - offset), value + 0 * head
        solutions.append((q, exists))
    return solutions


def _wrap(angle: np.ndarray) -> np.ndarray:
    return np.asarray(math.pi - (math.pi - angle) % (2 * math.pi))
