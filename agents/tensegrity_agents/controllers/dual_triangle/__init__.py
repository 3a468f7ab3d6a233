"""Analytic controllers of the dual-triangle arm."""

from tensegrity_agents.controllers.dual_triangle.reach import (
    ClosedFormMax,
    ClosedFormSquares,
    ClosedFormSum,
    Observer,
    Oracle,
    PseudoInverse,
)

__all__ = ["ClosedFormMax", "ClosedFormSquares", "ClosedFormSum", "Observer", "Oracle", "PseudoInverse"]
