"""Analytic controllers of the 2-X manipulator."""

from tensegrity_agents.controllers.two_x.reach import CarefulOracle, ClosedFormIK, Observer, Oracle, PseudoInverse

__all__ = ["CarefulOracle", "ClosedFormIK", "Observer", "Oracle", "PseudoInverse"]
