"""Tasks: what is to be done with a mechanism, what is seen of it, and what it is worth."""

from tensegrity_envs.tasks.reach import Reach, RewardWeights

__all__ = ["Reach", "RewardWeights"]
