"""Analytic controllers of the dual-triangle arm."""

from tensegrity_agents.controllers.dual_triangle.push import HoldInputs, PushObserver, PushOracle, PushPseudoInverse
from tensegrity_agents.controllers.dual_triangle.reach import (
    ClosedFormMax,
    ClosedFormSquares,
    ClosedFormSum,
    Observer,
    Oracle,
    PseudoInverse,
)
from tensegrity_agents.controllers.dual_triangle.servo import IdentifyingObserver, Servo

__all__ = [
    "ClosedFormMax",
    "ClosedFormSquares",
    "ClosedFormSum",
    "HoldInputs",
    "IdentifyingObserver",
    "Observer",
    "Oracle",
    "PseudoInverse",
    "PushObserver",
    "PushOracle",
    "PushPseudoInverse",
    "Servo",
]
