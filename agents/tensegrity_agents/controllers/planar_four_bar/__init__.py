"""Analytic controllers of the planar 4-bar mechanism, and what its nominal model tells agents."""

from tensegrity_agents.controllers.planar_four_bar.hints import Hints
from tensegrity_agents.controllers.planar_four_bar.loaded_hints import LoadedHints
from tensegrity_agents.controllers.planar_four_bar.reach import ClosedFormIK, Observer, Oracle, PseudoInverse

__all__ = ["ClosedFormIK", "Hints", "LoadedHints", "Observer", "Oracle", "PseudoInverse"]
