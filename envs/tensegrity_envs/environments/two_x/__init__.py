"""The 2-X manipulator as environments."""

from tensegrity_envs.environments.two_x.posture import TwoXPostureChange
from tensegrity_envs.environments.two_x.reach import TwoXReach

__all__ = ["TwoXPostureChange", "TwoXReach"]
