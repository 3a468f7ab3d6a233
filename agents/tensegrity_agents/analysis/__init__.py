"""Analyses of mechanisms: figures, regions as GeoJSON, numbers and a page for browsing, one folder per design."""

from tensegrity_agents.analysis.catalogue import ANALYSES, analyze, as_text, notes_on_designs
from tensegrity_agents.analysis.designs import parse_design

__all__ = ["ANALYSES", "analyze", "as_text", "notes_on_designs", "parse_design"]
