"""Analytic controllers of arms of any number of X-joints."""

from tensegrity_agents.controllers.n_x.reach import CarefulOracle, ClosedFormIK, Observer, Oracle, PseudoInverse

__all__ = ["CarefulOracle", "ClosedFormIK", "Observer", "Oracle", "PseudoInverse"]
