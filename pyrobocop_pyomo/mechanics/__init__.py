"""Reusable models of contact mechanics."""

from . import planar, spatial
from .physical_score import PhysicalScore, ScoreLimits
from .planar_pushing import SquareSlider

__all__ = ["PhysicalScore", "ScoreLimits", "SquareSlider", "planar", "spatial"]
