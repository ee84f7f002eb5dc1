"""Bodies among obstacles: distances, rows that keep them apart, robots from files, paths to start from, pictures.

Paths of bodies along waypoints, and of cars by hybrid A*, are initial guesses; parking cases come from files as
competitions publish them. Pictures and animations need Matplotlib.
"""

from importlib import import_module
from typing import Any

from pyrobocop_pyomo.geometry import Pose, signed_distance
from pyrobocop_pyomo.obstacles import animate_avoidance, draw_avoidance
from pyrobocop_pyomo.phases.initial_guesses import waypoint_initial_guess
from pyrobocop_pyomo.plotting import BodyPath, animate_scene, draw_scene

# Names of `contrib`, whose folders are loaded at their first use.
_OF_CONTRIB = {
    "robots": "cover_occupancy_grid cover_point_cloud decompose from_urdf sampled_path",
    "vehicles": "CarSearch ParkingCar ParkingCase Trailer VehiclesCase hybrid_a_star parking_model plan_vehicles",
}
_ON_DEMAND = {name: home for home, names in _OF_CONTRIB.items() for name in names.split()}


__all__ = [
    "BodyPath",
    "Pose",
    "animate_avoidance",
    "animate_scene",
    "draw_avoidance",
    "draw_scene",
    "signed_distance",
    "waypoint_initial_guess",
    *_ON_DEMAND,
]


def __getattr__(name: str) -> Any:
    """A name of `contrib`."""
    if name not in _ON_DEMAND:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"pyrobocop_pyomo.contrib.{_ON_DEMAND[name]}"), name)
