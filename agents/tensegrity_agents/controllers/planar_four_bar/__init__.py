"""Analytic controllers of the planar 4-bar mechanism, and features that its nominal model gives agents."""

from tensegrity_agents.controllers.planar_four_bar.features import Features
from tensegrity_agents.controllers.planar_four_bar.loaded_features import LoadedFeatures
from tensegrity_agents.controllers.planar_four_bar.reach import ClosedFormIK, Observer, Oracle, PseudoInverse

__all__ = ["ClosedFormIK", "Features", "LoadedFeatures", "Observer", "Oracle", "PseudoInverse"]
