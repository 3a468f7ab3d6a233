"""The analysis of the planar 4-bar mechanism."""

from tensegrity_agents.analysis.planar_four_bar.run import analyze

__all__ = ["analyze"]
