"""Gymnasium environments for tensegrity manipulators. Importing this package registers their ids.

import gymnasium as gym
import tensegrity_envs

env = gym.make("tensegrity/TwoXReach-v0")
envs = gym.make_vec("tensegrity/TwoXReach-v0", 256, vectorization_mode="vector_entry_point")
"""

from tensegrity_envs.linear import LinearModel, linearize
from tensegrity_envs.registration import ENTRIES, ENV_IDS, register_all
from tensegrity_envs.simulation.protocol import termination_reason
from tensegrity_envs.warming import compile_all

__version__ = "0.1.0"
__all__ = ["ENTRIES", "ENV_IDS", "LinearModel", "__version__", "compile_all", "linearize", "termination_reason"]

register_all()
