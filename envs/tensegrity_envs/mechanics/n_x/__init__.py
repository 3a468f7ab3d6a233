"""The planar n-X manipulator: a chain of any number of X-joints."""

from tensegrity_envs.mechanics.n_x.design import THREE_X, NXDesign
from tensegrity_envs.mechanics.n_x.mechanism import NX

__all__ = ["NX", "THREE_X", "NXDesign"]
