"""The analysis of the dual-triangle arm."""

from tensegrity_agents.analysis.dual_triangle.run import analyze

__all__ = ["analyze"]
