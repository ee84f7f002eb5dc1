"""Reusable models of contact mechanics."""

from .planar_pushing import SquareSlider

__all__ = ["SquareSlider"]
