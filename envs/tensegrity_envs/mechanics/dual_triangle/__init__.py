"""The compliant serial arm of dual-triangles."""

from tensegrity_envs.mechanics.dual_triangle.branches import Branch
from tensegrity_envs.mechanics.dual_triangle.design import ZHAO2021_CAPTION, ZHAO2021_TEXT, DualTriangleDesign
from tensegrity_envs.mechanics.dual_triangle.inverse import InverseSolution
from tensegrity_envs.mechanics.dual_triangle.loads import LoadedState
from tensegrity_envs.mechanics.dual_triangle.mechanism import DualTriangle
from tensegrity_envs.mechanics.dual_triangle.redundancy import Redundancy
from tensegrity_envs.mechanics.dual_triangle.segment import DualTriangleSegment, Fold

__all__ = [
    "ZHAO2021_CAPTION",
    "ZHAO2021_TEXT",
    "Branch",
    "DualTriangle",
    "DualTriangleDesign",
    "DualTriangleSegment",
    "Fold",
    "InverseSolution",
    "LoadedState",
    "Redundancy",
]
