"""The analysis of the spatial prism."""

from tensegrity_agents.analysis.spatial_prism.run import analyze

__all__ = ["analyze"]
