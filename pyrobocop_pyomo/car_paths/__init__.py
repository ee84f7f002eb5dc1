"""Paths of cars among obstacles, as initial guesses: hybrid A* with Reeds-Shepp paths."""

from .car_path import CarPath, CarTiming
from .hybrid_a_star import hybrid_a_star
from .motion_primitives import CarSearch

__all__ = ["CarPath", "CarSearch", "CarTiming", "hybrid_a_star"]
