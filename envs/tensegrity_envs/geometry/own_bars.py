"""Which bars of a planar mechanism can meet each other. Derived here; see docs/obstacles.md.

The bars of a mechanism make up rigid bodies: two bars belong to one where all distances between their ends stay the
same in whatever posture. A pair of bars counts where their bodies are different and no pin joins these, unless the two
bars cross in every posture: they do so by construction, and lie in different planes. What is the same in every posture
is told from some that are drawn at random.
"""

from typing import Any

import numpy as np

from tensegrity_envs.geometry.clearance import bars_of
from tensegrity_envs.mechanics.design import check_one_design
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar

_POSTURES = 64
_WIDEST = 3.0  # [rad] of joint angles: anti-parallelograms are flat at pi
_OPEN = 0.1  # least stability margin of a rectangle
_SAME = 1e-9  # over the mechanism's size


def own_pairs(mechanism: Any) -> tuple[tuple[str, str], ...]:
    """Names of the pairs of bars of a planar mechanism that could touch each other.

    Of bars that lie on one another in every posture, as sides that two triangles share, the first one stands for all.

    Args:
        mechanism: of one design.

    Raises:
        TypeError: the mechanism is spatial.
        ValueError: it is a batch of designs.
    """
    check_one_design(mechanism.design, "own_pairs")
    bars = bars_of(mechanism, *_postures(mechanism))
    names = list(bars)
    ends = np.array([[[np.broadcast_to(x, _POSTURES) for x in end] for end in bars[name]] for name in names])
    size = np.ptp(ends.reshape(-1, 2, _POSTURES), axis=0).max()
    apart = np.hypot(*np.moveaxis(ends[:, :, None, None] - ends[None, None], 4, 0)) / size  # (bar, end, bar, end, k)
    body = _bodies((np.ptp(apart, axis=-1) < _SAME).all(axis=(1, 3)))
    together = (apart < _SAME).all(axis=-1)
    covered = (together.any(axis=3).all(axis=1) & np.tri(len(names), k=-1, dtype=bool)).any(axis=1)
    touching = together.any(axis=(1, 3))
    pairs = []
    for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
        is_joined = touching[np.ix_(body == body[i], body == body[j])].any()
        if not (covered[i] or covered[j] or body[i] == body[j] or is_joined or _crosses(ends[i], ends[j]).all()):
            pairs.append((names[i], names[j]))
    return tuple(pairs)


def _postures(mechanism: Any) -> tuple[Any, Any]:
    """Configurations, and inputs where nodes depend on them."""
    rng = np.random.default_rng(0)
    if isinstance(mechanism, PlanarFourBar):
        lengths = 2 * float(mechanism.length) * rng.uniform(0.01, 0.99, (2, 100 * _POSTURES))
        is_open = 2 * np.min(mechanism.flatness(tuple(lengths)), axis=0) > _OPEN
        chosen = tuple(lengths[:, is_open][:, :_POSTURES])
        return mechanism.rectangle(chosen, np.where(np.arange(_POSTURES) % 2, 1.0, -1.0))[0], chosen
    if not hasattr(mechanism.design, "joint_limit"):
        raise TypeError(f"{type(mechanism).__name__}: has no joint angles in a plane; this is for planar mechanisms")
    limit = min(float(mechanism.design.joint_limit), _WIDEST)
    return tuple(rng.uniform(-limit, limit, (mechanism.degrees_of_freedom, _POSTURES))), None


def _bodies(rigid: np.ndarray) -> np.ndarray:
    """The number of each bar's body, from which bars (n, n) keep their distances."""
    body = np.arange(len(rigid))
    for i in range(len(rigid)):
        body[np.isin(body, body[rigid[i]])] = body[i]
    return body


def _crosses(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Whether two segments, ends (2, 2, k), cross in each posture."""

    def sides(line: np.ndarray, points: np.ndarray) -> np.ndarray:
        (ax, ay), (bx, by) = line
        return np.asarray([(bx - ax) * (y - ay) - (by - ay) * (x - ax) for x, y in points])

    return np.asarray((sides(first, second).prod(axis=0) < 0) & (sides(second, first).prod(axis=0) < 0))
