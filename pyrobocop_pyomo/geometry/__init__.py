"""Convex shapes, poses and exact distances, in the plane and in space. Knows no model."""

from .decomposition import decompose
from .distance import SignedDistance, distance_of_points, distances_of_points, signed_distance
from .polytope import Polytope
from .poses import Pose, check_pose, planar_pose, spatial_pose
from .separation import gap, separating_directions

__all__ = [
    "Polytope",
    "Pose",
    "SignedDistance",
    "check_pose",
    "decompose",
    "distance_of_points",
    "distances_of_points",
    "gap",
    "planar_pose",
    "separating_directions",
    "signed_distance",
    "spatial_pose",
]
