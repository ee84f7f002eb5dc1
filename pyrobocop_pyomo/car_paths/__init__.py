"""Paths of cars among obstacles, as initial guesses: hybrid A* on Reeds-Shepp moves."""

from .car_moves import CarSearch
from .car_path import CarPath
from .car_timing import CarTiming
from .hybrid_a_star import hybrid_a_star

__all__ = [
    "CarPath",
    "CarSearch",
    "CarTiming",
    "hybrid_a_star",
]
