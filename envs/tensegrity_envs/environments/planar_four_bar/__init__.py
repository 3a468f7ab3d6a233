"""The planar 4-bar mechanism as environments."""

from tensegrity_envs.environments.planar_four_bar.reach import PlanarFourBarReach

__all__ = ["PlanarFourBarReach"]
