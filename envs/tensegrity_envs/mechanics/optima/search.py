"""The search for local optima, of any arm.

Two joints have finitely many solutions. Three move along curves while the tip rests, on which points walk downhill.
More move on surfaces, on which many slide downhill; programmes start where the best of these ended, and at places of
the arm's own, which include corners and faces. What is no local optimum is left out, but for the best that was found.
That these are all local optima is no theorem: tests compare with searches from 200 starts.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from tensegrity_envs.mechanics.optima.descent import slide, walk
from tensegrity_envs.mechanics.optima.objectives import Measure
from tensegrity_envs.mechanics.optima.optimality import SAME, grouped, polished
from tensegrity_envs.mechanics.optima.pieces import Problem

GROUP = 0.05  # [rad]: slides that end as near together are taken for one
_MOST_GROUPS = {"sum": 12, "max": 12, "squares": 12, "margin": 5}  # of a target: the best ones


def local_optima(
    arm: Any,
    x: np.ndarray,
    y: np.ndarray,
    begun: tuple[np.ndarray, np.ndarray],
    objective: str,
    measure: Measure,
    limit: float,
    problem: Callable[[int], Problem],
    places: Callable[[int], np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All that were found: index of the target (k,), configurations (n, k), values (k,), best first.

    Args:
        arm: of one design.
        x, y: targets of shape (m,) [m].
        begun: indices (j,) of targets, and configurations (n, j) with the tip there, within the limits.
        objective: "sum", "max", "squares" or "margin".
        measure: what is to be small.
        limit: of the joint angles [rad].
        problem: of each target, of four joints or more.
        places: of each target, where programmes start besides, (n, any); of four joints or more.
    """
    owner, q = begun
    if len(q) == 3:
        q, value = walk(arm, q, owner, x, y, measure, limit)
    elif len(q) > 3:
        q, value = slide(arm, q, owner, x, y, measure, limit)
        best = grouped(owner, q, value, GROUP, _MOST_GROUPS[objective])
        ends = [polished(problem(i), np.hstack([q[:, best[owner[best] == i]], places(i)])) for i in range(len(x))]
        owner = np.repeat(np.arange(len(x)), [end.shape[1] for end in ends])
        q = np.hstack([np.zeros((len(q), 0)), *ends])
    value = measure(q, owner)
    kept = grouped(owner, q, value, SAME)
    return owner[kept], q[:, kept], (-value[kept] if objective == "margin" else value[kept])
