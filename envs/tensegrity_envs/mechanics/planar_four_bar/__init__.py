"""The planar 4-bar class-2 tensegrity mechanism."""

from tensegrity_envs.mechanics.planar_four_bar.design import JI2014, PlanarFourBarDesign
from tensegrity_envs.mechanics.planar_four_bar.equilibria import FourBarEquilibrium
from tensegrity_envs.mechanics.planar_four_bar.inverse import InverseSolution
from tensegrity_envs.mechanics.planar_four_bar.kinematics import ForwardSolution
from tensegrity_envs.mechanics.planar_four_bar.mechanism import PlanarFourBar

__all__ = [
    "JI2014",
    "ForwardSolution",
    "FourBarEquilibrium",
    "InverseSolution",
    "PlanarFourBar",
    "PlanarFourBarDesign",
]
