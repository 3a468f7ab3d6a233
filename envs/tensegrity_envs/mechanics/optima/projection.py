"""The tip put onto a target by the smallest steps of the joints."""

from typing import Any

import numpy as np


def project(
    arm: Any,
    q: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    limit: float,
    rounds: int = 40,
    ways: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (n, k) moved to where their tips are at the targets; and which of them are, within the limits.

    Joints move along `ways` (r, n, k) only, where these are given.
    """
    size = float(arm.reach)
    q = q.copy()
    for _ in range(rounds):
        px, py = arm.tip(tuple(q))
        ex, ey = px - x, py - y
        if max(np.abs(ex).max(initial=0.0), np.abs(ey).max(initial=0.0)) < 1e-15 * size:
            break
        step = shortest_step(arm, q, ex, ey, size, ways)
        length = np.abs(step).max(axis=0)
        q = np.clip(q - step * (0.5 / np.maximum(0.5, length)), -limit, limit)
    px, py = arm.tip(tuple(q))
    return q, np.asarray(np.hypot(px - x, py - y) < 1e-12 * size)


def shortest_step(
    arm: Any, q: np.ndarray, ex: np.ndarray, ey: np.ndarray, size: float, ways: np.ndarray | None = None
) -> np.ndarray:
    """The smallest joint steps (n, k) [rad] that move the tips by (ex, ey) [m] to first order; `size` is the reach.

    Of `ways` (r, n, k) the smallest multiples of these.
    """
    rows = arm.jacobian(tuple(q))
    jx, jy = (np.stack([np.broadcast_to(entry, ex.shape) for entry in row]) for row in rows)
    if ways is not None:
        jx, jy = (ways * jx).sum(axis=1), (ways * jy).sum(axis=1)
    damping = 1e-3 * (ex * ex + ey * ey) + 1e-30 * size**2
    a, b, c = (jx * jx).sum(0) + damping, (jx * jy).sum(0), (jy * jy).sum(0) + damping
    det = a * c - b * b
    step = np.asarray(jx * ((c * ex - b * ey) / det) + jy * ((a * ey - b * ex) / det))
    return step if ways is None else np.asarray((ways * step[:, None]).sum(axis=0))
