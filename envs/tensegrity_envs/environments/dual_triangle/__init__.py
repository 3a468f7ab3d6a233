"""The dual-triangle arm as environments."""

from tensegrity_envs.environments.dual_triangle.push import DualTrianglePush
from tensegrity_envs.environments.dual_triangle.reach import DualTriangleReach

__all__ = ["DualTrianglePush", "DualTriangleReach"]
