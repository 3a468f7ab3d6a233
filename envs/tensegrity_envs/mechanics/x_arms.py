"""The arms of X-joints: what holds for the 2-X and for chains of any number of joints takes either."""

from tensegrity_envs.mechanics.n_x import NX, NXDesign
from tensegrity_envs.mechanics.two_x import TwoX, TwoXDesign

XArm = TwoX | NX
XDesign = TwoXDesign | NXDesign
