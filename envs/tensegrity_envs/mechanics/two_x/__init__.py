"""The planar 2-X manipulator of [Furet2018] and [Muralidharan2022]."""

from tensegrity_envs.mechanics.two_x.design import FURET2018, MURALIDHARAN2022, TwoXDesign
from tensegrity_envs.mechanics.two_x.inverse import InverseSolution, furet_quartic
from tensegrity_envs.mechanics.two_x.mechanism import TwoX

__all__ = ["FURET2018", "MURALIDHARAN2022", "InverseSolution", "TwoX", "TwoXDesign", "furet_quartic"]
