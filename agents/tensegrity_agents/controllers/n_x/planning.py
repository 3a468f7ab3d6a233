"""Joint paths of arms with a continuum of inverse solutions: which one to go straight to."""

import numpy as np

from tensegrity_agents.controllers.two_x.planning import straight_clearance
from tensegrity_envs.mechanics import NX
from tensegrity_envs.mechanics.n_x.postures import postures_at

_NEAREST = 48  # solutions of each target whose straight path is looked at
_WORTH = 4.0  # [rad] of a longer path is what enough margin is worth against none


def choose_posture(
    model: NX, start: np.ndarray, target: np.ndarray, enough: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Of many solutions of each target the one whose straight joint path stays feasible and is shortest.

    Args:
        model: one design, or one for each of n targets.
        start: configurations (n, joints) [rad].
        target: positions (n, 2) [m].
        enough: least margin along a path [-] up to which more of it is worth a longer path.

    Returns:
        The configurations (n, joints), and whether their straight path is feasible (n,). Where none is, the one whose
        path keeps the largest margin; where no solution is found, the start.
    """
    owner, q = postures_at(model, *target.T)
    length = np.abs(q - start.T[:, owner]).max(axis=0)
    order = np.lexsort((length, owner))
    owner, q, length = owner[order], q[:, order], length[order]
    first = np.searchsorted(owner, np.arange(len(start)))
    near = np.arange(len(owner)) - first[owner] < _NEAREST
    owner, q, length = owner[near], q[:, near], length[near]
    clearance = straight_clearance(model.take(owner), start.T[:, owner], q) if len(owner) else np.zeros(0)
    worth = 100.0 - length
    if enough > 0:
        worth = worth + _WORTH * np.minimum(clearance / enough, 1.0)
    rank = np.where(clearance > 0, worth, np.minimum(clearance, 0.0))
    order = np.lexsort((-rank, owner))
    found, best = np.unique(owner[order], return_index=True)
    chosen, straight = start.copy(), np.zeros(len(start), bool)
    chosen[found], straight[found] = q[:, order[best]].T, clearance[order[best]] > 0
    return chosen, straight
