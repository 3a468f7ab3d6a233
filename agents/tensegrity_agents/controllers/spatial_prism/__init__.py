"""Analytic controllers of the spatial prism."""

from tensegrity_agents.controllers.spatial_prism.track import ClosedFormIK, Observer, Oracle, PseudoInverse

__all__ = ["ClosedFormIK", "Observer", "Oracle", "PseudoInverse"]
