"""All zeros of one segment's torque, proved by bounds of its stiffness; limits of its control law."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tensegrity_envs.mechanics.dual_triangle.segment_statics import SegmentStatics

_CELLS = 64
_LARGEST_CLUSTER = 1e-2  # [rad]
_ROUNDING = 8 * 2.0**-52  # of a torque, relative to the sum of what it is computed from
_MOST_CELLS = 400_000  # undecided ones
_UNDECIDED = 1e-7  # [rad]
_NARROWEST = 1e-9  # [rad]: what is left undecided at this width is a double root, or none


def stiffness_bounds(
    segment: SegmentStatics, free_lengths: tuple[float, float], low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds of the stiffness [N m/rad] on the intervals [low, high] of q, shape (n,).

    With v = cos^2(theta/2), a taut spring contributes k c1 c2 [1 - 2 v + L0 Q(v)],

        Q = ((2 v - 1) d^2 + 4 c1 c2 v^2) / (d^2 + 4 c1 c2 v)^(3/2),  d = c1 - c2,

    and Q rises with v everywhere: dQ/dv has the sign of 2 d^4 + (4 v + 6) d^2 c1 c2 + 8 (c1 c2 v)^2. So both parts are
    monotone in v, and their bounds are their values at the ends.
    """
    design, gg, d = segment.design, segment._gg, segment._d
    lower, upper = np.zeros_like(low), np.zeros_like(low)
    for sign, k, free in ((1.0, design.k1, free_lengths[0]), (-1.0, design.k2, free_lengths[1])):
        ends = (design.beta12 + sign * low) / 2, (design.beta12 + sign * high) / 2
        squares = [np.cos(end) ** 2 for end in ends]
        v0, v1 = np.minimum(*squares), np.where(ends[0] * ends[1] <= 0, 1.0, np.maximum(*squares))
        v0 = np.maximum(v0, 1e-60)
        lengths = [np.sqrt(d * d + 4 * gg * v) for v in (v0, v1)]
        rising = [
            free * ((2 * v - 1) * d * d + 4 * gg * v * v) / length**3
            for v, length in zip((v0, v1), lengths, strict=True)
        ]
        least = k * gg * (1 - 2 * v1 + np.minimum(*rising))
        most = k * gg * (1 - 2 * v0 + np.maximum(*rising))
        if design.springs == "cable":
            taut, slack = lengths[0] >= free, lengths[1] <= free
            least = np.where(taut, least, np.where(slack, 0.0, np.minimum(least, 0.0)))
            most = np.where(taut, most, np.where(slack, 0.0, np.maximum(most, 0.0)))
        lower, upper = lower + least, upper + most
    slop = 1e-13 * segment.stiffness_scale * (1 + (free_lengths[0] + free_lengths[1]) / (design.b1 + design.b2))
    exact = (lower == 0) & (upper == 0)  # both cables slack
    return np.where(exact, 0.0, lower - slop), np.where(exact, 0.0, upper + slop)


class Stretch(NamedTuple):
    """An interval of angles [rad] on which the stiffness is positive (sign 1), negative (-1), or zero: cables slack."""

    low: float
    high: float
    sign: int


def stretches(segment: SegmentStatics, free_lengths: tuple[float, float]) -> list[Stretch]:
    """The stretches into which the signs of the stiffness divide the range of angles, ascending.

    Bounds of the stiffness prove the sign on every interval but those narrower than 1e-7 rad, next to a zero.
    """
    limit = float(segment.design.joint_limit)
    edges = np.linspace(-limit, limit, _CELLS + 1)
    low, high = edges[:-1], edges[1:]
    pieces: list[tuple[float, float, int]] = []
    while len(low):
        least, most = stiffness_bounds(segment, free_lengths, low, high)
        sign = np.where(least > 0, 1, np.where(most < 0, -1, 0))
        known = (sign != 0) | ((least == 0) & (most == 0))
        pieces += zip(low[known].tolist(), high[known].tolist(), sign[known].tolist(), strict=True)
        left = ~known & (high - low > _UNDECIDED)
        if left.sum() > _MOST_CELLS:  # the torque is (all but) constant there: as if both cables were slack
            pieces += [(a, b, 0) for a, b in zip(low[left].tolist(), high[left].tolist(), strict=True)]
            break
        low, high = _halved(low[left], high[left])
    found: list[Stretch] = []
    for a, b, kind in sorted(pieces):
        if found and found[-1].sign == kind and (kind != 0 or a - found[-1].high < _UNDECIDED):
            found[-1] = Stretch(found[-1].low, b, kind)  # what is undecided between them is no extremum
        elif found:
            middle = (found[-1].high + a) / 2
            found[-1] = Stretch(found[-1].low, middle, found[-1].sign)
            found.append(Stretch(middle, b, kind))
        else:
            found.append(Stretch(-limit, b, kind))
    if found:
        found[-1] = Stretch(found[-1].low, limit, found[-1].sign)
    return found


def _halved(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    middle = (low + high) / 2
    return np.concatenate([low, middle]), np.concatenate([middle, high])


def roots(segment: SegmentStatics, free_lengths: tuple[float, float], moment: float) -> list[float]:
    """All angles strictly inside the joint limits at which torque + moment = 0, ascending [rad]."""
    from scipy.optimize import brentq  # slow to import, and only needed here

    limit = float(segment.design.joint_limit)
    size = segment.stiffness_scale + abs(moment)

    def excess(q: float) -> float:
        return float(segment.torque(q, free_lengths) + moment)

    edges = np.linspace(-limit, limit, _CELLS + 1)
    low, high = edges[:-1], edges[1:]
    found: list[float] = []
    doubtful: list[float] = []
    neutral: list[tuple[float, float]] = []
    while len(low):
        least, most = stiffness_bounds(segment, free_lengths, low, high)
        middle, half = (low + high) / 2, (high - low) / 2
        at_middle = np.abs(segment.torque(middle, free_lengths) + moment)
        idle = (least == 0) & (most == 0)
        for a, b in zip(low[idle & (at_middle == 0)], high[idle & (at_middle == 0)], strict=True):
            neutral.append((float(a), float(b)))
        monotone = ((least > 0) | (most < 0)) & ~idle
        for a, b in zip(low[monotone].tolist(), high[monotone].tolist(), strict=True):
            first, last = excess(a), excess(b)
            if first * last <= 0:
                found.append(a if first == 0 else b if last == 0 else float(brentq(excess, a, b, xtol=1e-16)))
        empty = at_middle > np.maximum(-least, most) * half + 1e-14 * size
        left = ~monotone & ~idle & ~empty
        narrow = left & (half < _NARROWEST)
        doubtful += middle[narrow & (at_middle < 1e-12 * size)].tolist()
        left &= ~narrow
        if left.sum() > _MOST_CELLS:  # nothing but rounding: every angle there is in equilibrium
            neutral += [(a, b) for a, b in zip(low[left].tolist(), high[left].tolist(), strict=True)]
            break
        low, high = _halved(low[left], high[left])
    for start, end in _merged(sorted(neutral)):
        found = [q for q in found if not start - 1e-9 <= q <= end + 1e-9]
        found.append((start + end) / 2)
    # A double root leaves a cluster of undecided intervals around itself, the midpoint of which is best.
    for start, end in _merged(sorted((q - 4e-7, q + 4e-7) for q in doubtful)):
        if not any(start - 1e-7 <= q <= end + 1e-7 for q in found):
            found.append((start + end) / 2)
    distinct: list[list[float]] = []
    for q in sorted(found):
        if abs(q) >= limit - 1e-12:
            continue
        if distinct and (q - distinct[-1][-1] < 1e-11 or _are_one(segment, free_lengths, moment, distinct[-1][-1], q)):
            distinct[-1].append(q)
        else:
            distinct.append([q])
    return [(cluster[0] + cluster[-1]) / 2 for cluster in distinct]


def _are_one(
    segment: SegmentStatics, free_lengths: tuple[float, float], moment: float, first: float, last: float
) -> bool:
    """Whether the torque between two zeros is nothing but rounding: then they are one."""
    if last - first > _LARGEST_CLUSTER:
        return False
    q = np.linspace(first, last, 33)
    rounding = abs(moment)
    for k, free, spring in zip(
        (segment.design.k1, segment.design.k2), free_lengths, segment.springs(np, q), strict=True
    ):
        rounding = rounding + k * (spring.length + abs(free)) * abs(spring.arm)
    excess = np.abs(segment.torque(q, free_lengths) + moment)
    return bool((excess <= _ROUNDING * rounding).all())


def _merged(intervals: list[tuple[float, float]]) -> list[tuple[float, float]]:
    merged: list[tuple[float, float]] = []
    for start, end in intervals:
        if merged and start <= merged[-1][1] + 1e-12:
            merged[-1] = (merged[-1][0], max(end, merged[-1][1]))
        else:
            merged.append((start, end))
    return merged


def is_monotone(segment: SegmentStatics, free_lengths: tuple[float, float]) -> bool:
    """Whether the stiffness is positive everywhere strictly inside the joint limits."""
    limit = float(segment.design.joint_limit)
    low, high = np.array([-limit]), np.array([limit])
    while len(low):
        middle = (low + high) / 2
        if np.any(segment.stiffness(middle, free_lengths) <= 0):
            return False
        least, _ = stiffness_bounds(segment, free_lengths, low, high)
        left = (least <= 0) & (high - low > _NARROWEST)
        low, high = _halved(low[left], high[left])
    return True


def control_limit(segment: SegmentStatics) -> float:
    """See `SegmentStatics.control_limit`."""
    from scipy.optimize import brentq  # slow to import, and only needed here

    limit = float(segment.design.joint_limit)
    least, most = (float(value) for value in segment.delta_range)

    def margin(q: float) -> float:
        delta = float(segment.control(q))
        return min(delta - least, most - delta)

    angles = np.linspace(0.0, limit, 400)
    ends = []
    for side in (-1.0, 1.0):
        delta = segment.control(side * angles)
        outside = np.flatnonzero(np.minimum(delta - least, most - delta) < 0)
        if not len(outside):
            ends.append(limit)
        elif outside[0] == 0:
            ends.append(0.0)
        else:
            a, b = angles[outside[0] - 1], angles[outside[0]]
            ends.append(float(brentq(lambda q, side=side: margin(side * q), a, b, xtol=1e-15)))
    return min(ends)
