"""Trajectories: read by name, interpolate, plot, save, exchange. Knows no model."""

from .joined import JoinedTrajectory, join_trajectories
from .trajectory import Trajectory

__all__ = ["JoinedTrajectory", "Trajectory", "join_trajectories"]
