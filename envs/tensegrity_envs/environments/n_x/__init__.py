"""The n-X manipulator as environments."""

from tensegrity_envs.environments.n_x.reach import NXReach

__all__ = ["NXReach"]
