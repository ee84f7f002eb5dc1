"""Convex shapes, poses and exact distances, in the plane and in space. Knows no model."""

from .distance import PointSets as PointSets
from .distance import SignedDistance, signed_distance
from .distance import distance_of_points as distance_of_points
from .distance import distances_of_points as distances_of_points
from .distance import distances_of_shapes as distances_of_shapes
from .distance import separating_directions as separating_directions
from .path_bounds import PathBounds as PathBounds
from .path_bounds import heights as heights
from .polytope import Polytope as Polytope
from .poses import Pose
from .poses import check_pose as check_pose
from .poses import planar_pose as planar_pose
from .poses import spatial_pose as spatial_pose

# What users find in the namespace `geometry`. The names with "as" are for the folders of this package;
# users find `Polytope` and the two functions of poses at the package root.
__all__ = [
    "Pose",
    "SignedDistance",
    "signed_distance",
]
