"""Analytic controllers of the planar 4-bar mechanism."""

from tensegrity_agents.controllers.planar_four_bar.reach import ClosedFormIK, Observer, Oracle, PseudoInverse

__all__ = ["ClosedFormIK", "Observer", "Oracle", "PseudoInverse"]
