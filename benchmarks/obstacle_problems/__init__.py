"""Plans around obstacles that the benchmarks measure: the examples, restated, and random scenes by seed."""

from .car_in_street import random_parking, random_warehouse
from .field import field, near_pairs
from .quadrotor import random_flight
from .restating import fix_ends, model_size, restate, sampled_distance, start_on_quarter_circle
from .scattered import ROBOTS, random_scene, scattered
from .shelf import random_shelf

__all__ = [
    "ROBOTS",
    "field",
    "fix_ends",
    "model_size",
    "near_pairs",
    "random_flight",
    "random_parking",
    "random_scene",
    "random_shelf",
    "random_warehouse",
    "restate",
    "sampled_distance",
    "scattered",
    "start_on_quarter_circle",
]
