"""The margin of an arm of dual-triangles as smooth pieces: free lengths, and stiffness along unit vectors."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.optima.pieces import Table, unit_vectors


def margin_pieces(arm: Any, load: Sequence[Component]) -> Table:
    """Minus the margin is the largest of minus 2 L_i0 / (b1 + b2) and minus v.H v / stiffness_scale of unit vectors v.

    H is the stiffness matrix at the control law's free lengths L_i0.
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
    """Unit vectors (n, w) of the stiffness matrix at a configuration (n,), see `unit_vectors`."""
    lengths = arm.free_lengths(arm.control(tuple(q[:, None]), load))
    return unit_vectors(_hessians(arm, q[:, None], lengths, load)[:, :, 0])


def _hessians(arm: Any, q: np.ndarray, lengths: Components, load: Sequence[Component]) -> np.ndarray:
    table = np.zeros((arm.segments, *q.shape))
    for i, row in enumerate(arm.stiffness_matrix(tuple(q), lengths, load)):
        for j, entry in enumerate(row):
            table[i, j] = entry
    return table
