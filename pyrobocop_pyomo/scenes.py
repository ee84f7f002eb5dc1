"""Bodies among obstacles: distances, rows that keep them apart, robots from files, paths to start from, pictures.

The formulations are values of `formulation=` of an `ObstacleAvoidanceBlock`. Paths of bodies along waypoints, and of
cars by hybrid A*, are initial guesses; parking cases come from files as competitions publish them. Pictures and
animations need Matplotlib.
"""

from pyrobocop_pyomo.car_paths import (
    CarPath,
    CarSearch,
    CarTiming,
    ParkingCar,
    ParkingCase,
    Trailer,
    VehiclesCase,
    hybrid_a_star,
)
from pyrobocop_pyomo.geometry import (
    Pose,
    SignedDistance,
    cover_occupancy_grid,
    cover_point_cloud,
    decompose,
    signed_distance,
)
from pyrobocop_pyomo.obstacles import (
    Dual,
    Formulation,
    Mixed,
    Offset,
    Optimality,
    Plane,
    TurningPlane,
    animate_avoidance,
    draw_avoidance,
    parking_model,
    sampled_path,
    waypoint_initial_guess,
)
from pyrobocop_pyomo.planning import VehicleMove, VehiclesPlan, plan_vehicles
from pyrobocop_pyomo.plotting import (
    AnimationFile,
    BodyPath,
    animate_scene,
    draw_linkage,
    draw_planar_pushing,
    draw_scene,
)
from pyrobocop_pyomo.robots import DescribedRobot, from_urdf

__all__ = [
    "AnimationFile",
    "BodyPath",
    "CarPath",
    "CarSearch",
    "CarTiming",
    "DescribedRobot",
    "Dual",
    "Formulation",
    "Mixed",
    "Offset",
    "Optimality",
    "ParkingCar",
    "ParkingCase",
    "Plane",
    "Pose",
    "SignedDistance",
    "Trailer",
    "TurningPlane",
    "VehicleMove",
    "VehiclesCase",
    "VehiclesPlan",
    "animate_avoidance",
    "animate_scene",
    "cover_occupancy_grid",
    "cover_point_cloud",
    "decompose",
    "draw_avoidance",
    "draw_linkage",
    "draw_planar_pushing",
    "draw_scene",
    "from_urdf",
    "hybrid_a_star",
    "parking_model",
    "plan_vehicles",
    "sampled_path",
    "signed_distance",
    "waypoint_initial_guess",
]
