"""Analytic controllers of the 2-X manipulator."""

from tensegrity_agents.controllers.two_x.reach import CarefulOracle, ClosedFormIK, Observer, Oracle, PseudoInverse
from tensegrity_agents.controllers.two_x.servo import IdentifyingObserver, Servo

__all__ = ["CarefulOracle", "ClosedFormIK", "IdentifyingObserver", "Observer", "Oracle", "PseudoInverse", "Servo"]
