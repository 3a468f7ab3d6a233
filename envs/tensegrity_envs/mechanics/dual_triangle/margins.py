"""The margin of an arm of dual-triangles as smooth pieces: free lengths, and stiffness along unit vectors."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.n_x.pieces import Table

_BETWEEN = 8  # unit vectors between the eigenvectors of the two smallest eigenvalues, and these


def margin_pieces(arm: Any, load: Sequence[Component]) -> Table:
    """Minus the margin is the largest of minus 2 L_i0 / (b1 + b2) and minus v.H v / stiffness_scale of unit vectors v.

    H is the stiffness matrix at the control law's free lengths L_i0; the smallest eigenvalue is at most v.H v for every
    v, so that the frame of H's eigenvectors at a configuration gives its margin, and their mixtures what is nearby.
    """
    first = arm.chain[0].design

    def pieces(q: np.ndarray, frame: np.ndarray) -> np.ndarray:
        lengths = arm.free_lengths(arm.control(tuple(q), load))
        table = _hessians(arm, q, lengths, load)
        along = np.einsum("iw,ijk,jw->wk", frame, table, frame) / arm.stiffness_scale
        room = np.stack(lengths) * (2 / (first.b1 + first.b2))
        return -np.concatenate([along, room])

    return pieces


def eigenvectors(arm: Any, q: np.ndarray, load: Sequence[Component]) -> np.ndarray:
    """Unit vectors (n, w): the eigenvectors of H at a configuration (n,), and mixtures of the first two of them."""
    lengths = arm.free_lengths(arm.control(tuple(q[:, None]), load))
    vectors = np.linalg.eigh(_hessians(arm, q[:, None], lengths, load)[:, :, 0])[1]
    angle = np.pi * np.arange(1, _BETWEEN) / _BETWEEN
    return np.hstack([vectors, np.outer(vectors[:, 0], np.cos(angle)) + np.outer(vectors[:, 1], np.sin(angle))])


def _hessians(arm: Any, q: np.ndarray, lengths: Components, load: Sequence[Component]) -> np.ndarray:
    table = np.zeros((arm.segments, *q.shape))
    for i, row in enumerate(arm.stiffness_matrix(tuple(q), lengths, load)):
        for j, entry in enumerate(row):
            table[i, j] = entry
    return table
