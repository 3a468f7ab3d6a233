"""Holding a posture as stiffly as the free lengths allow: co-contraction, and the load that it then withstands.

With all free lengths as inputs a segment's angle fixes one combination of its two free lengths (the control law), and
leaves the other, `common`, which on bilateral springs adds stiffness the longer the springs are. So the stiffest inputs
of a posture are at a bound, and what is left to choose is the posture on the self-motion curve.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.dual_triangle.identification import links
from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.mechanics.dual_triangle import DualTriangle, DualTriangleDesign
from tensegrity_envs.mechanics.dual_triangle.self_motion import SINGLE, SelfMotion

_BISECTIONS = 12
_CLEAR = 1e-4  # [rad] of the joint limits


class Held(NamedTuple):
    """How postures are held; arrays of one shape.

    Attributes:
        free_lengths: six of them [m].
        stability_margin: of the posture [-]; -1 beyond the joint limits, or where no free lengths hold it.
    """

    free_lengths: Components
    stability_margin: Component


def _held(
    design: DualTriangleDesign,
    segments: int,
    q: Components,
    load: Components,
    common: Components,
    share: Component,
    bounds: tuple[Component, Component],
) -> Held:
    arm = DualTriangle(design, segments)
    xp = namespace_of(*q)
    unit = design.b1
    none, one = arm.control(q, load), arm.control(q, load, unit)
    low, high = bounds
    lengths: list[Component] = []
    possible: Component = 1.0
    for d0, d1, c in zip(none, one, common, strict=True):
        slope = (d1 - d0) / unit
        top: Component = 1e6
        bottom: Component = -1e6
        for nominal, sign in ((design.free_length1, -1.0), (design.free_length2, 1.0)):
            # low <= nominal + sign d0 + (1 + sign slope) common <= high
            rise, base = 1.0 + sign * slope, nominal + sign * d0
            rise = xp.where(abs(rise) > 1e-9, rise, 1e-9)
            one_end, other = (low - base) / rise, (high - base) / rise
            top = xp.minimum(top, xp.maximum(one_end, other))
            bottom = xp.maximum(bottom, xp.minimum(one_end, other))
        possible = xp.minimum(possible, xp.where(top >= bottom, 1.0, 0.0))
        taken = xp.maximum(xp.minimum(c + share * (top - c), top), bottom)
        delta = d0 + slope * taken
        lengths += [design.free_length1 + taken - delta, design.free_length2 + taken + delta]
    margin = arm.stability_margin(q, tuple(lengths), load)
    fine = (possible > 0) & (arm.limit_margin(q) > _CLEAR)
    return Held(tuple(lengths), xp.where(fine, margin, -1.0))


def hold(
    arm: DualTriangle,
    bounds: tuple[float, float],
    q: Sequence[Component] | np.ndarray,
    load: Sequence[Component],
    common: Sequence[Component] = (0.0, 0.0, 0.0),
    share: Component = 1.0,
) -> Held:
    """The free lengths that hold postures under loads, between given common parts and the stiffest ones.

    Args:
        arm: nominal.
        bounds: of the free lengths [m].
        q: three angles [rad], arrays of one shape.
        load: (fx, fy) [N]; broadcasts.
        common: what is common to the free lengths of each segment now, beyond the nominal ones, three of them [m].
        share: how far from there to the stiffest ones they are; by default all of it.
    """
    shape = np.broadcast_shapes(*(np.shape(v) for v in (*q, *load)), np.shape(share))
    flat = [np.broadcast_to(np.asarray(v, float), shape).ravel() for v in (*q, *load, *common, share)]
    low, high = (float(b) for b in bounds)
    found = evaluate(
        _held, arm.design, arm.segments, tuple(flat[:3]), tuple(flat[3:5]), tuple(flat[5:8]), flat[8], (low, high)
    )
    lengths = tuple(np.asarray(v).reshape(shape) for v in found.free_lengths)
    margin = np.asarray(found.stability_margin).reshape(shape)
    return Held(lengths, np.where(np.isfinite(margin), margin, -1.0))


def withstood(
    arm: DualTriangle,
    bounds: tuple[float, float],
    q: Sequence[Component] | np.ndarray,
    unit: Sequence[Component],
    largest: float,
) -> np.ndarray:
    """The largest force [N] in the direction `unit` under which postures can be held stably, at the stiffest inputs."""
    low = np.zeros(np.shape(q[0]))
    high = np.full(np.shape(q[0]), largest)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        fine = hold(arm, bounds, q, (middle * unit[0], middle * unit[1])).stability_margin > 0
        low, high = np.where(fine, middle, low), np.where(fine, high, middle)
    return low


class Loop:
    """The self-motion curves of n targets that lie far out, so that each is one closed curve, parametrized by s.

    Args:
        arm: nominal.
        tip: (x, y), arrays of shape (n,) [m].
    """

    def __init__(self, arm: DualTriangle, tip: tuple[np.ndarray, np.ndarray]) -> None:
        pivot, long, short = links(arm)
        x, y = tip[0] - pivot, tip[1]
        distance = np.clip(np.hypot(x, y), 2 * long - short, (2 * long + short) * (1 - 1e-9))
        self._curve = SelfMotion(SINGLE, distance, np.arctan2(y, x), long, short)

    def at(self, s: np.ndarray) -> np.ndarray:
        """Postures (3, n) [rad]."""
        return np.stack(self._curve.at(np.arange(len(s)), np.zeros(len(s)), s))

    def place(self, q: np.ndarray) -> np.ndarray:
        """The parameter s in [0, 2 pi) of postures (3, n) on the curves."""
        turn = np.pi - (np.pi - (q[0] - self._curve.direction)) % (2 * np.pi)
        s = np.arccos(np.clip(turn / self._curve.w_hi, -1.0, 1.0))
        return np.asarray(np.where(q[2] >= 0, s, 2 * np.pi - s) % (2 * np.pi))
