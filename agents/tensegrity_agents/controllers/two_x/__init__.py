"""Analytic controllers of the 2-X manipulator."""

from tensegrity_agents.controllers.two_x.analytic import ClosedFormIK, Observer, Oracle, PseudoInverse

__all__ = ["ClosedFormIK", "Observer", "Oracle", "PseudoInverse"]
