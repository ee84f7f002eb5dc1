"""A car, two slots to park it in, and an independent check of its paths."""

import math
from typing import Any

import numpy as np

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.vehicles import hybrid_a_star
from pyrobocop_pyomo.contrib.vehicles.car_path import CarPath

WHEELBASE, STEERING = 2.7, 0.6
CAR = rcp.Polytope.from_vertices([(-1, -1), (3.7, -1), (3.7, 1), (-1, 1)], name="car")
START = (-6.0, 9.5, 0.0)


def without_end(normals: Any, offsets: Any) -> rcp.Polytope:
    return rcp.Polytope.from_halfspaces(normals, offsets, bounded=False)


def slot(half_width: float) -> dict[str, rcp.Polytope]:
    return {
        "left": without_end([[1, 0], [0, 1]], [-half_width, 5]),
        "right": without_end([[-1, 0], [0, 1]], [-half_width, 5]),
        "wall": without_end([[0, -1]], [-11]),
    }


REVERSE = {"goal": (0.0, 1.3, math.pi / 2), "obstacles": slot(1.3)}
PARALLEL = {"goal": (-1.35, 4.0, 0.0), "obstacles": {**slot(3.0), "bottom": without_end([[0, 1]], [2.5])}}


def park(start: Any = START, scene: Any = REVERSE, clearance: float = 0.1, **options: Any) -> CarPath:
    options = {
        "bounds": ((-15, 15), (1, 10)),
        "wheelbase": WHEELBASE,
        "steering_limit": STEERING,
        "body": CAR,
        "time_limit": 600.0,  # a busy machine is no reason to fail
    } | options
    return hybrid_a_star(start, **{**scene, **options}, clearance=clearance)


def least_distance(path: CarPath, obstacles: Any, body: rcp.Polytope = CAR, every: float = 0.02) -> float:
    """By the exact distance, which shares nothing with the search, at poses along the path's own arcs."""
    shapes = list(obstacles.values() if isinstance(obstacles, dict) else obstacles)
    driven = np.linspace(0.0, path.length, 2 + int(path.length / every))
    poses = [rcp.planar_pose(*pose) for pose in path.poses_at(driven).tolist()]
    return min(rcp.scenes.signed_distance(body, shape, pose).distance for pose in poses for shape in shapes)


def is_free(pose: Any, obstacles: Any, clearance: float) -> bool:
    return all(
        rcp.scenes.signed_distance(CAR, shape, rcp.planar_pose(*pose)).distance >= clearance
        for shape in obstacles.values()
    )
