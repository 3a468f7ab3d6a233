"""The spatial prism as environments."""

from tensegrity_envs.environments.spatial_prism.track import SpatialPrismTrack

__all__ = ["SpatialPrismTrack"]
