"""Robots that other programs describe, scenes from maps and point clouds, and paths among random configurations."""

from .decomposition import decompose
from .occupancy_grids import cover_occupancy_grid
from .point_clouds import cover_point_cloud
from .sampled_path import sampled_path
from .urdf import DescribedRobot, from_urdf

__all__ = [
    "DescribedRobot",
    "cover_occupancy_grid",
    "cover_point_cloud",
    "decompose",
    "from_urdf",
    "sampled_path",
]
