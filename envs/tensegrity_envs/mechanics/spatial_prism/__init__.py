"""The spatial tensegrity prism of [Jahromy]: three prismatic actuators, three springs, a platform of three cables."""

from tensegrity_envs.mechanics.spatial_prism.design import JAHROMY, SpatialPrismDesign
from tensegrity_envs.mechanics.spatial_prism.loaded import LoadedEquilibrium, UnloadingLimit
from tensegrity_envs.mechanics.spatial_prism.mechanism import SpatialPrism
from tensegrity_envs.mechanics.spatial_prism.trajectories import TRAJECTORIES, trajectory31, trajectory32

__all__ = [
    "JAHROMY",
    "TRAJECTORIES",
    "LoadedEquilibrium",
    "SpatialPrism",
    "SpatialPrismDesign",
    "UnloadingLimit",
    "trajectory31",
    "trajectory32",
]
