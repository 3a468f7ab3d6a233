"""Tasks: what is to be done with a mechanism, and what it is worth."""

from tensegrity_envs.tasks.base import Task
from tensegrity_envs.tasks.fast_reach import FastReach
from tensegrity_envs.tasks.hold import Hold
from tensegrity_envs.tasks.obstacle_reach import ObstacleInputReach, ObstacleReach
from tensegrity_envs.tasks.posture import Posture
from tensegrity_envs.tasks.reach import InputReach, Reach
from tensegrity_envs.tasks.track import Track
from tensegrity_envs.tasks.weights import (
    HoldWeights,
    ObstacleReachWeights,
    PostureWeights,
    ReachWeights,
    TrackWeights,
    Weights,
)

__all__ = [
    "FastReach",
    "Hold",
    "HoldWeights",
    "InputReach",
    "ObstacleInputReach",
    "ObstacleReach",
    "ObstacleReachWeights",
    "Posture",
    "PostureWeights",
    "Reach",
    "ReachWeights",
    "Task",
    "Track",
    "TrackWeights",
    "Weights",
]
