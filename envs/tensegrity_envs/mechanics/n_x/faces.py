"""Joints of a chain that bring the tip to a target while others are held: places where searches begin.

Two X-joints with others between and beyond them have no closed form; Newton's method starts from many of their angles.
"""

import numpy as np

from tensegrity_envs.mechanics.n_x.chain import CableArm
from tensegrity_envs.mechanics.optima.faces import equal_signs, within
from tensegrity_envs.mechanics.optima.projection import project

_DISTANCES, _ANGLES = (
    6,
    6,
)  # of the joints that are equally far, and of the other one, from which Newton's method starts
_ROUNDS = 25


def completed(
    arm: CableArm, q: np.ndarray, pair: tuple[int, int], target: tuple[float, float], limit: float, tries: int
) -> np.ndarray:
    """Configurations (n, any) with the tip at the target that differ from these (n, k) in a pair of joints only.

    Of each of these from its own angles of the pair, and from `tries` - 1 others.
    """
    n, k = q.shape
    others = np.random.default_rng(3).uniform(-limit, limit, (2, tries, k))
    others[:, 0] = q[list(pair)]
    begun = np.repeat(q[:, None], tries, axis=1)
    begun[list(pair)] = others
    ways = np.eye(n)[list(pair)][..., None]
    return _moved(arm, begun.reshape(n, -1), target, limit, ways)


def equal_corners(arm: CableArm, centre: np.ndarray, target: tuple[float, float], limit: float) -> np.ndarray:
    """Configurations (n, any) at the target of which all joints but one are as far from `centre` (n,) as each other."""
    n, found = len(centre), []
    far, angle = np.meshgrid(
        np.linspace(0, limit, _DISTANCES + 1)[1:], np.linspace(-limit, limit, _ANGLES + 2)[1:-1], indexing="ij"
    )
    for joint in range(n):
        signs = equal_signs(n, joint)
        way = np.repeat(signs, far.size, axis=1)
        q = centre[:, None] + way * np.tile(far.ravel(), signs.shape[1])
        q[joint] = np.tile(angle.ravel(), signs.shape[1])
        alone = np.broadcast_to(np.eye(n)[joint][:, None], way.shape)
        moved = _moved(arm, q, target, np.inf, np.stack([way, alone]))
        found.append(within(moved, limit))
    return np.hstack(found)


def _moved(arm: CableArm, q: np.ndarray, target: tuple[float, float], limit: float, ways: np.ndarray) -> np.ndarray:
    """Where Newton's method along the ways leads to from configurations (n, k), each once."""
    x, y = (np.full(q.shape[1], place) for place in target)
    q, there = project(arm, q, x, y, limit, _ROUNDS, ways)
    q = q[:, there]
    return q[:, np.unique(np.round(q, 5), axis=1, return_index=True)[1]]
