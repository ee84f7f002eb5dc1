"""Plans around obstacles that the benchmarks measure: the examples, restated, and random scenes by seed."""

from .car_in_street import random_parking
from .field import field, near_pairs
from .quadrotor import random_flight
from .restating import fix_ends, model_size, restate, sampled_distance, start_on_quarter_circle

__all__ = [
    "field",
    "fix_ends",
    "model_size",
    "near_pairs",
    "random_flight",
    "random_parking",
    "restate",
    "sampled_distance",
    "start_on_quarter_circle",
]
