"""Tasks: what is to be done with a mechanism, and what it is worth."""

from tensegrity_envs.tasks.hold import Hold
from tensegrity_envs.tasks.protocol import Task
from tensegrity_envs.tasks.reach import Reach
from tensegrity_envs.tasks.weights import HoldWeights, ReachWeights

__all__ = ["Hold", "HoldWeights", "Reach", "ReachWeights", "Task"]
