"""The analysis of the 2-X manipulator."""

from tensegrity_agents.analysis.two_x.run import analyze

__all__ = ["analyze"]
