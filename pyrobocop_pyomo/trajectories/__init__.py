"""Trajectories: read by name, interpolate, plot, save, exchange. Knows no model."""

from .trajectory import Trajectory

__all__ = ["Trajectory"]
