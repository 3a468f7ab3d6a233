"""The margins of a chain of X-joints, and with cables of each joint the smaller one as smooth pieces. Derived here.

With cables of each joint, one of both is at max_tension. The other one is F_right where that is the left one, F_left
where it is the right one: the lesser of these two functions, both of which are smooth. So is what the cables add to the
joint's stiffness. The margin is therefore the least of F_right and F_left, less min_tension and over max_tension, and
of v.H v / stiffness_scale for all unit vectors v and both choices of each joint.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.n_x import tensions
from tensegrity_envs.mechanics.n_x.chain import symmetric
from tensegrity_envs.mechanics.n_x.routing import FROM_BASE
from tensegrity_envs.mechanics.optima.objectives import Margins
from tensegrity_envs.mechanics.optima.pieces import Table, unit_vectors

_UNDECIDED = 3  # joints of which both choices are tried: those at which they differ least


def margins_of(arm: Any, load: Sequence[Component]) -> Margins:
    """Stability and wrench margin of configurations under a load."""

    def margins(q: np.ndarray) -> Sequence[np.ndarray]:
        here = tuple(q)
        with np.errstate(all="ignore"):
            if arm.design.routing == FROM_BASE:  # compiled, as facets are enumerated: a hundred times as fast
                return tuple(evaluate(_margins, arm.design, here, type(arm), tuple(map(float, load))))
            return tuple(arm.posture(here, load)[1:])

    return margins


def _margins(design: Any, q: Components, arm: Any, load: Components) -> Components:
    return tuple(arm(design).posture(q, load)[1:])


class _Parts(NamedTuple):
    """Of configurations (n, k): the stiffness matrix without cables, and both choices of each joint.

    Attributes:
        passive: shape (n, n, k) [N m/rad].
        added: what the cables add to its diagonal with the left, the right one at max_tension, shape (2, n, k).
        room: the other one less min_tension, over max_tension, shape (2, n, k).
    """

    passive: np.ndarray
    added: np.ndarray
    room: np.ndarray


def _parts(arm: Any, q: np.ndarray, load: Sequence[Component]) -> _Parts:
    n, k = q.shape
    found = evaluate(_components, arm.design, tuple(q), type(arm), tuple(map(float, load)))
    table = np.array(found).reshape(-1, k)
    return _Parts(table[: n * n].reshape(n, n, k), *table[n * n :].reshape(2, 2, n, k))


def _components(design: Any, q: Components, arm: Any, load: Components) -> Components:
    """The entries of `_Parts`, one after the other."""
    chain = arm(design)
    xp = chain.namespace(*q, *load)
    joints = chain.joints(xp, q)
    gradient, hessian = chain.passive(joints, load)
    low, high = design.min_tension, design.max_tension
    others = [tensions.others_at_bound(tensions.held(xp, joint, g), high) for joint, g in zip(joints, gradient)]
    of_left = tensions.stiffness_of_cables(joints, [(high, right) for right, _ in others])
    of_right = tensions.stiffness_of_cables(joints, [(left, high) for _, left in others])
    room = [(pair[side] - low) / high for side in (0, 1) for pair in others]
    return (*(entry for row in symmetric(hessian) for entry in row), *of_left, *of_right, *room)


def margin_pieces(arm: Any, load: Sequence[Component]) -> Table:
    """Minus the margin is the largest of these; see the module. A frame has unit vectors above choices (2 n, w)."""

    def pieces(q: np.ndarray, frame: np.ndarray) -> np.ndarray:
        parts, (vectors, choice) = _parts(arm, q, load), np.split(frame, 2)
        along = np.einsum("iw,ijk,jw->wk", vectors, parts.passive, vectors)
        for side in (0, 1):
            along += np.einsum("iw,ik->wk", np.where(choice == side, vectors**2, 0.0), parts.added[side])
        return -np.concatenate([along / float(arm.stiffness_scale), parts.room.reshape(-1, q.shape[1])])

    return pieces


def frame_at(arm: Any, q: np.ndarray, load: Sequence[Component]) -> np.ndarray:
    """Unit vectors of the stiffness matrix at a configuration (n,), with choices of each joint, (2 n, w)."""
    parts = _parts(arm, q[:, None], load)
    first, second = parts.added[..., 0]
    vectors = unit_vectors(parts.passive[..., 0] + np.diag(np.minimum(first, second)))
    open_joints = np.argsort(np.abs(first - second), kind="stable")[:_UNDECIDED]
    blocks = []
    for sides in product((0, 1), repeat=len(open_joints)):
        choice = np.where(first <= second, 0, 1)
        choice[open_joints] = sides
        blocks.append(np.vstack([vectors, np.repeat(choice[:, None], vectors.shape[1], axis=1)]))
    return np.hstack(blocks)
