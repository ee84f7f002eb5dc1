"""What is refused before a path for a car is looked for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import GuessError
from pyrobocop_pyomo.geometry import Polytope, planar_pose, signed_distance

from .way_estimates import Bounds

Array = NDArray[np.float64]


def named_obstacles(obstacles: Mapping[str, Polytope] | Sequence[Polytope]) -> list[Polytope]:
    """Obstacles under the names that messages use."""
    if not isinstance(obstacles, Mapping):
        obstacles = {f"obstacle {i}": each for i, each in enumerate(obstacles, 1)}
    for name, each in obstacles.items():
        if not isinstance(each, Polytope) or each.dimension != 2:
            raise GuessError(f"hybrid_a_star: obstacle '{name}' is {each!r}; expected a Polytope in the plane.")
    return [each.named(str(name)) for name, each in obstacles.items()]


def check_car(
    body: Polytope, obstacles: list[Polytope], wheelbase: float, steering_limit: float, clearance: float, limit: float
) -> None:
    """Refuse a body, a steering, a clearance or a time that makes no sense."""
    if not isinstance(body, Polytope) or body.dimension != 2 or not body.is_bounded:
        raise GuessError(f"hybrid_a_star: the body is {body!s}; expected a bounded Polytope in the plane.")
    for name, number in (("wheelbase", wheelbase), ("time_limit", limit)):
        if not (math.isfinite(number) and number > 0.0):
            raise GuessError(f"hybrid_a_star: {name} = {number}; expected a positive number.")
    if not 0.0 < steering_limit < 0.5 * math.pi:
        raise GuessError(f"hybrid_a_star: steering_limit = {steering_limit}; expected radians between 0 and pi / 2.")
    if not (math.isfinite(clearance) and clearance >= 0.0):
        raise GuessError(f"hybrid_a_star: clearance = {clearance}; expected a length that is not negative.")


def checked_pose(pose: Sequence[float], which: str) -> Array:
    """Three finite numbers."""
    numbers = np.array(pose, dtype=float)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise GuessError(f"hybrid_a_star: the {which} is {pose!r}; expected three finite numbers (x, y, heading).")
    return numbers


def checked_bounds(bounds: Bounds) -> Bounds:
    """Two finite intervals that are not empty."""
    numbers = np.array(bounds, dtype=float)
    if numbers.shape != (2, 2) or not np.isfinite(numbers).all() or (numbers[:, 0] >= numbers[:, 1]).any():
        raise GuessError(f"hybrid_a_star: bounds = {bounds!r}; expected ((x_min, x_max), (y_min, y_max)), finite.")
    (left, right), (bottom, top) = numbers.tolist()
    return (left, right), (bottom, top)


def check_end(
    pose: Array, which: str, body: Polytope, obstacles: list[Polytope], bounds: Bounds, clearance: float
) -> None:
    """Refuse an end out of bounds or too close to an obstacle; judged by the exact distance, apart from the search."""
    for axis, (low, high) in enumerate(bounds):
        if not low <= pose[axis] <= high:
            raise GuessError(
                f"hybrid_a_star: the {which} has {'xy'[axis]} = {pose[axis]:g}, out of the bounds from {low:g} to "
                f"{high:g}. Widen the bounds, or move the {which}."
            )
    for each in obstacles:
        distance = signed_distance(body, each, planar_pose(*pose.tolist())).distance
        if distance < clearance - 1e-9:
            how = f"overlaps it by {-distance:.6g}" if distance < 0 else f"is only {distance:.6g} away from it"
            raise GuessError(
                f"hybrid_a_star: at the {which} ({pose[0]:g}, {pose[1]:g}, {pose[2]:g}) '{body.name}' collides with "
                f"'{each.name}': it {how}, and a clearance of {clearance:g} is asked for. Move the {which}, or ask for "
                "less."
            )
