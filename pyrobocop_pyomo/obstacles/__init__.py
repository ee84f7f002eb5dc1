"""Obstacles: where bodies may be, and guesses that lead around what is in the way."""

from .car_moves import CarSearch
from .car_path import CarPath
from .car_timing import CarTiming
from .hybrid_a_star import hybrid_a_star
from .waypoint_guess import waypoint_guess

__all__ = [
    "CarPath",
    "CarSearch",
    "CarTiming",
    "hybrid_a_star",
    "waypoint_guess",
]
