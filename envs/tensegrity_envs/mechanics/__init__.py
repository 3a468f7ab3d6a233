"""Mechanics of the published mechanisms: kinematics, statics, stability, wrench feasibility. No Gymnasium, no Torch."""

from tensegrity_envs.mechanics.dual_triangle import (
    ZHAO2021_CAPTION,
    ZHAO2021_TEXT,
    DualTriangle,
    DualTriangleDesign,
    DualTriangleSegment,
)
from tensegrity_envs.mechanics.equilibrium import Equilibrium
from tensegrity_envs.mechanics.n_x import NX, THREE_X, NXDesign
from tensegrity_envs.mechanics.planar_four_bar import JI2014, PlanarFourBar, PlanarFourBarDesign
from tensegrity_envs.mechanics.protocol import Mechanism
from tensegrity_envs.mechanics.spatial_prism import JAHROMY, SpatialPrism, SpatialPrismDesign
from tensegrity_envs.mechanics.two_x import FURET2018, MURALIDHARAN2022, InverseSolution, TwoX, TwoXDesign

MECHANISMS: tuple[type[Mechanism], ...] = (DualTriangle, NX, PlanarFourBar, SpatialPrism, TwoX)

__all__ = [
    "FURET2018",
    "JAHROMY",
    "JI2014",
    "MECHANISMS",
    "MURALIDHARAN2022",
    "NX",
    "THREE_X",
    "ZHAO2021_CAPTION",
    "ZHAO2021_TEXT",
    "DualTriangle",
    "DualTriangleDesign",
    "DualTriangleSegment",
    "Equilibrium",
    "InverseSolution",
    "Mechanism",
    "NXDesign",
    "PlanarFourBar",
    "PlanarFourBarDesign",
    "SpatialPrism",
    "SpatialPrismDesign",
    "TwoX",
    "TwoXDesign",
]
