"""Ways downhill that leave the tip where it is: along the curves of three joints, along the surfaces of more."""

from typing import Any

import numpy as np

from tensegrity_envs.mechanics.optima.objectives import Measure
from tensegrity_envs.mechanics.optima.projection import project, shortest_step

_FIRST_STEP, _LAST_STEP, _LONGEST_STEP = 0.02, 1e-11, 0.1  # [rad] of a walk
_MOST_STEPS = 400
_SLIDES = 120
_FIRST_SLIDE, _LAST_SLIDE = 0.2, 1e-4  # [rad]


def walk(
    arm: Any, q: np.ndarray, owner: np.ndarray, x: np.ndarray, y: np.ndarray, measure: Measure, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points (3, k) of the curves of their targets walk downhill until steps of 1e-11 rad lead nowhere better."""
    size = float(arm.reach)
    q, value = q.copy(), measure(q, owner)
    step, sign, failed = np.full(len(owner), _FIRST_STEP), np.ones(len(owner)), np.zeros(len(owner), bool)
    heading = np.zeros_like(q)
    active = np.arange(len(owner))
    for _ in range(_MOST_STEPS):
        if not len(active):
            break
        here, target = q[:, active], owner[active]
        (xa, xb, xc), (ya, yb, yc) = arm.jacobian(tuple(here))
        tangent = np.stack([xb * yc - xc * yb, xc * ya - xa * yc, xa * yb - xb * ya])
        tangent /= np.maximum(np.sqrt((tangent * tangent).sum(axis=0)), 1e-300)
        turn = np.where((tangent * heading[:, active]).sum(axis=0) < 0, -1.0, 1.0)
        tangent = tangent * turn
        heading[:, active] = tangent
        new = here + tangent * (sign[active] * step[active])
        for _ in range(3):
            px, py = arm.tip(tuple(new))
            new = new - shortest_step(arm, new, px - x[target], py - y[target], size)
        px, py = arm.tip(tuple(new))
        fine = np.hypot(px - x[target], py - y[target]) < 1e-12 * size
        fine &= (np.abs(new) <= limit).all(axis=0)
        fine &= np.abs(new - here).max(axis=0) < 2 * step[active]
        tried = np.where(fine, measure(np.where(fine, new, here), target), np.inf)
        better = tried < value[active]
        q[:, active[better]], value[active[better]] = new[:, better], tried[better]
        step[active] = np.where(better, np.minimum(1.5 * step[active], _LONGEST_STEP), step[active])
        worse = active[~better]
        both = failed[worse]  # neither way is better: shorter steps
        step[worse[both]] *= 0.3
        sign[worse] *= -1
        failed[worse] = ~both
        failed[active[better]] = False
        active = active[step[active] > _LAST_STEP]
    return q, value


def slide(
    arm: Any, q: np.ndarray, owner: np.ndarray, x: np.ndarray, y: np.ndarray, measure: Measure, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (n, k) move downhill along random directions that leave the tip at rest; and their values (k,)."""
    size, rng = float(arm.reach), np.random.default_rng(1)
    q, value, step = q.copy(), measure(q, owner), np.full(len(owner), _FIRST_SLIDE)
    for _ in range(_SLIDES):
        way = rng.normal(size=q.shape)
        jx, jy = (np.stack([np.broadcast_to(e, way[0].shape) for e in row]) for row in arm.jacobian(tuple(q)))
        way = way - shortest_step(arm, q, (jx * way).sum(axis=0), (jy * way).sum(axis=0), size)
        way = way * (step / np.maximum(np.abs(way).max(axis=0), 1e-300))
        improved = np.zeros(len(owner), bool)
        for sign in (1.0, -1.0):
            new, there = project(arm, q + sign * way, x[owner], y[owner], limit, 4)
            tried = np.where(there, measure(new, owner), np.inf)
            better = (tried < value) & ~improved
            q, value = np.where(better, new, q), np.where(better, tried, value)
            improved |= better
        step = np.clip(np.where(improved, 1.5 * step, 0.75 * step), _LAST_SLIDE, _FIRST_SLIDE)
    return q, value
