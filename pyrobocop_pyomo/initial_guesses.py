"""Initial guesses that are computed: paths of bodies along waypoints, and of cars by hybrid A*."""

from pyrobocop_pyomo.car_paths import CarPath, CarSearch, CarTiming, hybrid_a_star
from pyrobocop_pyomo.obstacles import waypoint_initial_guess

__all__ = ["CarPath", "CarSearch", "CarTiming", "hybrid_a_star", "waypoint_initial_guess"]
