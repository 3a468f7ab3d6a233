"""Planar mechanisms among obstacles, as environments."""

from tensegrity_envs.environments.obstacles.reach import (
    DualTriangleObstacleReach,
    NXObstacleReach,
    ObstacleCore,
    PlanarFourBarObstacleReach,
    TwoXObstacleReach,
)

__all__ = [
    "DualTriangleObstacleReach",
    "NXObstacleReach",
    "ObstacleCore",
    "PlanarFourBarObstacleReach",
    "TwoXObstacleReach",
]
