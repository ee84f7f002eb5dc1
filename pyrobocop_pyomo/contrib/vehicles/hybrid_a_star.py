"""Hybrid A*: a path for a car among obstacles, as an initial guess for a solver.

Space is usually tight at the goal, so the search starts there. From the start, all ways into a parking slot look alike
until the last metre; from the goal there are few ways out, and a Reeds-Shepp path in the open ends the search exactly.
A car that drives back along its path needs the same steering, so a path found from the goal is a path to the goal.

Where the start is tight too, the search from the goal takes long; where an end is so tight that no motion primitive is
free, it ends soon. Therefore two searches take turns, the one from the goal first. Each may expand more in its next
turn, and is repeated with finer primitives when it was exhausted.

A trailer follows stably while the car drives ahead only. This holds for its paths as well: what drives ahead out of a
bay at the goal is, driven back, the way into the bay in reverse.

References
----------
Dolgov, Thrun, Montemerlo, Diebel (2010). Path planning for autonomous vehicles in unknown semi-structured environments.
The International Journal of Robotics Research 29. https://doi.org/10.1177/0278364909359210
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.errors import InitialGuessError, PathNotFound
from pyrobocop_pyomo.geometry import Polytope, planar_pose, signed_distance
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy

from .best_first_search import BestFirstSearch, SearchEnd
from .car_kinematics import Trailer, follow_arcs
from .car_path import CarPath
from .cost_to_go import Bounds, CostToGo
from .free_space import FreeSpace, FreeSpaceWithTrailer
from .motion_primitives import CarSearch, MotionPrimitives
from .shortcuts import CHECKED_AT_ONCE, with_shortcuts

# Expansions of a search until the end of its first turn; twice as many until the end of each later one.
FIRST_TURN = 130
# The search from the start is for hard cases, where any path will do.
WEIGHT_FROM_START = 2.0
# The grid of distances: side of its cells in turning radii, and how many there are along its longer side.
GRID_CELL, MOST_CELLS = 0.03, 400
# Where two searches meet: turning radii from one pose to the other, a turn as the way of a point one radius away.
NEAR = 0.5
NEIGHBOURS = 3
# Pairs of poses whose Reeds-Shepp paths are computed.
PAIRS = 3000


def hybrid_a_star(
    start: Sequence[float],
    goal: Sequence[float],
    *,
    body: Polytope,
    obstacles: Mapping[str, Polytope] | Sequence[Polytope],
    wheelbase: float,
    steering_limit: float,
    bounds: Bounds,
    clearance: float = 0.0,
    search: CarSearch | None = None,
    time_limit: float | None = None,
    trailer: Trailer | None = None,
) -> CarPath:
    """Path of a car that keeps its clearance all along, proven between its poses as well.

    Parameters
    ----------
    start, goal : (x, y, heading)
        Of the middle of the rear axle; headings in radians. With a trailer (x, y, heading, angle).
    body : Polytope
        The car in its own frame: origin in the middle of the rear axle, x ahead. Bounded, in the plane.
    obstacles : dict of str to Polytope, or sequence
        May be without end (walls, wedges). In a sequence they are called "obstacle 1", ...
    wheelbase : float
        From axle to axle.
    steering_limit : float
        Largest steering angle, between 0 and pi / 2; the curvature of the path is ``tan(steering) / wheelbase``.
    bounds : ((x_min, x_max), (y_min, y_max))
        Where the middle of the rear axle may be at the poses of the path.
    clearance : float, optional
        Distance to keep from every obstacle.
    search : CarSearch, optional
        Resolution and costs.
    time_limit : float, optional
        Seconds. Without it, and as long as it is not reached, the answer does not depend on how busy the machine is.
    trailer : Trailer, optional
        Keeps the same clearance.

    Returns
    -------
    CarPath
        The same whenever it is requested.

    Raises
    ------
    InitialGuessError
        When start or goal are out of bounds or too close to an obstacle (which is named, with its distance).
    PathNotFound
        When no path is found.
    """
    options = CarSearch() if search is None else search
    shapes = _named_obstacles(obstacles)
    ends = {"goal": _checked_pose(goal, "goal", trailer), "start": _checked_pose(start, "start", trailer)}
    _check_car(body, shapes, wheelbase, steering_limit, clearance, time_limit)
    limits, deadline = _checked_bounds(bounds), Deadline.after(time_limit)
    for which, pose in ends.items():
        _check_end(pose, which, body, shapes, limits, clearance)
        if trailer is not None:
            _check_end(trailer.poses(pose), which, trailer.shape, shapes, None, clearance)
    if np.array_equal(ends["start"], ends["goal"]):
        raise InitialGuessError("hybrid_a_star: start and goal are the same pose; there is no path to find.")
    scene = body.reach + float(np.abs([*limits[0], *limits[1]]).max())
    scene += max((float(np.abs(shape.bounding_box).max()) for shape in shapes), default=0.0)
    coarse = MotionPrimitives.of(wheelbase, steering_limit, options, trailer=trailer)
    reach = body.reach if trailer is None else body.reach + trailer.length + trailer.shape.reach
    region = np.array(limits).T + np.array([[-reach], [reach]])
    cell = max(GRID_CELL * coarse.turning_radius, float(np.ptp(region, axis=0).max()) / MOST_CELLS)

    def free_space(shape: Polytope) -> FreeSpace:
        around = FreeSpace.around(shape, shapes, clearance, scene)
        enough = around.disc_radius + 2.0 * cell + coarse.turning_radius
        return around.with_grid(region[0], region[1], cell, enough)

    of_car = free_space(body)
    space = of_car if trailer is None else FreeSpaceWithTrailer(of_car, free_space(trailer.shape), trailer)

    def begin(which: str, cost_to_go: CostToGo, level: int) -> BestFirstSearch:
        primitives = MotionPrimitives.of(wheelbase, steering_limit, options, level, trailer)
        weight = options.heuristic_weight * (1.0 if which == "goal" else WEIGHT_FROM_START)
        return BestFirstSearch(ends[which], limits, primitives, weight, space, cost_to_go)

    searches: list[_EndSearch] = []
    turn = FIRST_TURN

    def run(current: _EndSearch) -> SearchEnd:
        left = options.max_expansions - sum(one.expansions for one in searches)
        return current.search.run(min(turn, current.search.expansions + left), deadline)

    while True:
        for k, (which, other) in enumerate((("goal", "start"), ("start", "goal"))):
            if k == len(searches):
                cost_to_go = CostToGo.to(ends[other], limits, body, shapes, clearance, coarse, scene)
                _check_disc(ends[which], cost_to_go)
                searches.append(_EndSearch(which, begin(which, cost_to_go, 0)))
            current = searches[k]
            end = run(current)
            while end is SearchEnd.EXHAUSTED and current.level < options.refinements:
                current.level += 1
                current.before += current.search.expansions
                current.search = begin(which, current.search.cost_to_go, current.level)
                end = run(current)
            arcs = current.search.arcs() if end is SearchEnd.FOUND else None
            if arcs is None and len(searches) == 2:
                arcs = _joined_arcs(current.search, searches[1 - k].search)
            if arcs is not None:
                arcs = with_shortcuts(current.search, *arcs)
                return _path(ends["start"], ends["goal"], *arcs, wheelbase, trailer, backwards=which == "goal")
            if end is SearchEnd.EXHAUSTED:
                raise PathNotFound(
                    f"hybrid_a_star: no path was found: from the {which}, {len(current.search.poses)} poses can be "
                    f"reached, none of which leads on. Try CarSearch(refinements={options.refinements + 1}), less "
                    "clearance, or wider bounds.",
                    sum(one.expansions for one in searches),
                )
        spent = sum(one.expansions for one in searches)
        if spent >= options.max_expansions or deadline.has_passed:
            reached = " and ".join(f"{len(one.search.poses)} poses from the {one.which}" for one in searches)
            limit = f"{options.max_expansions} expansions" + (
                "" if time_limit is None else f" and {time_limit:g} seconds"
            )
            raise PathNotFound(
                f"hybrid_a_star: no path was found within {limit}; reached were {reached}. Give "
                "CarSearch(max_expansions=...), more time, a coarser cell, or less clearance.",
                spent,
            )
        turn *= 2


@dataclass(eq=False)
class _EndSearch:
    """The search from one of the two ends, as far as it has come."""

    which: str
    search: BestFirstSearch
    level: int = 0
    before: int = 0

    @property
    def expansions(self) -> int:
        """Of all levels."""
        return self.before + self.search.expansions


def _joined_arcs(one: BestFirstSearch, other: BestFirstSearch) -> tuple[Array, Array] | None:
    """Signed lengths and curvatures of the arcs of a path from the root of one search to the root of the other.

    Reeds-Shepp paths lead from poses that one has reached to poses that the other has. Each search needs half of the
    shunts of a path then. The cost of a search grows like a power of their number.

    Parameters
    ----------
    one, other : BestFirstSearch
        With the same free space; neither has found a path.
    """
    radius = one.primitives.turning_radius
    mine, others = np.array(one.poses), np.array(other.poses)
    tree = scipy.spatial.cKDTree(_as_points(others, radius))
    # A trailer needs a way to get to another angle: a turning radius ahead or back.
    leads = np.zeros(1) if one.primitives.trailer is None else np.array([-radius, radius])
    places = one.primitives.follow(mine[:, None], leads[:, None], np.zeros((len(leads), 1)))[:, :, 1]
    apart, found = tree.query(_as_points(places, radius), NEIGHBOURS, distance_upper_bound=NEAR * radius)
    chosen = np.nonzero(np.isfinite(apart))
    here, there = chosen[0], found[chosen]
    costs = np.array(one.costs)[here] + np.array(other.costs)[there]
    kept = np.argsort(costs + apart[chosen], kind="stable")[:PAIRS]
    here, there, costs = here[kept], there[kept], costs[kept]
    if not len(here):
        return None
    between, lengths, turns = one.primitives.paths_to(mine[here], others[there])
    total = between + costs
    order = np.argsort(total, axis=None, kind="stable")[:CHECKED_AT_ONCE]
    kind, pair = np.unravel_index(order[np.isfinite(total.ravel()[order])], total.shape)
    arcs, curvatures, reached = one.primitives.connecting_arcs(
        mine[here[pair]], lengths[kind, pair], turns[kind], others[there[pair]]
    )
    clear = np.flatnonzero(reached)
    clear = clear[one.are_clear(mine[here[pair[clear]]], arcs[clear], curvatures[clear])]
    if not len(clear):
        return None
    best = int(clear[0])
    there_arcs, there_bends = other.arcs_to(int(there[pair[best]]))
    one_arcs, one_bends = one.arcs_to(int(here[pair[best]]))
    moves = arcs[best] != 0.0
    # A way that is driven back needs the same steering.
    return (
        np.concatenate([one_arcs, arcs[best][moves], -there_arcs[::-1]]),
        np.concatenate([one_bends, curvatures[best][moves], there_bends[::-1]]),
    )


def _as_points(poses: Array, radius: float) -> Array:
    heading = poses[..., 2:3]
    return np.concatenate(
        [poses[..., :2], radius * np.cos(heading), radius * np.sin(heading), radius * poses[..., 3:]], axis=-1
    )


def _check_disc(root: Array, cost_to_go: CostToGo) -> None:
    if math.isinf(cost_to_go.disc_path_length(root[None])[0]):
        raise PathNotFound(
            "hybrid_a_star: there is no path from start to goal: the obstacles and bounds leave no way even for a disc "
            "inside the car. Move an obstacle, widen the bounds or ask for less clearance.",
            0,
        )


def _path(
    start: Array, goal: Array, lengths: Array, curvatures: Array, wheelbase: float, trailer: Trailer | None,
    *, backwards: bool,
) -> CarPath:  # fmt: skip
    """The path from the start to the goal along arcs found from the start, or backwards from the goal."""
    poses = follow_arcs(goal if backwards else start, lengths, curvatures, trailer)
    if backwards:
        poses, lengths, curvatures = poses[::-1].copy(), -lengths[::-1], curvatures[::-1]
        poses[:, 2] += start[2] - poses[0, 2]
    # The ends exactly, up to whole turns: this takes off the rounding along the path.
    poses[0] = start
    turns = round((poses[-1, 2] - goal[2]) / (2.0 * math.pi))
    poses[-1] = goal
    poses[-1, 2] += 2.0 * math.pi * turns
    directions, steering = np.sign(lengths), np.arctan(wheelbase * curvatures)
    return CarPath(poses, np.append(directions, directions[-1]), np.append(steering, steering[-1]), trailer)


def _named_obstacles(obstacles: Mapping[str, Polytope] | Sequence[Polytope]) -> list[Polytope]:
    """Obstacles under the names that messages use."""
    if not isinstance(obstacles, Mapping):
        obstacles = {f"obstacle {i}": shape for i, shape in enumerate(obstacles, 1)}
    for name, shape in obstacles.items():
        if not isinstance(shape, Polytope) or shape.dimension != 2:
            raise InitialGuessError(f"hybrid_a_star: obstacle '{name}' is {shape!r}; expected a Polytope in the plane.")
    return [shape.named(str(name)) for name, shape in obstacles.items()]


def _check_car(
    body: Polytope,
    obstacles: list[Polytope],
    wheelbase: float,
    steering_limit: float,
    clearance: float,
    limit: float | None,
) -> None:
    """Refuse a body, a steering, a clearance or a time that makes no sense."""
    if not isinstance(body, Polytope) or body.dimension != 2 or not body.is_bounded:
        raise InitialGuessError(f"hybrid_a_star: the body is {body!s}; expected a bounded Polytope in the plane.")
    for name, number in (("wheelbase", wheelbase), ("time_limit", limit)):
        if number is not None and not (math.isfinite(number) and number > 0.0):
            raise InitialGuessError(f"hybrid_a_star: {name} = {number}; expected a positive number.")
    if not 0.0 < steering_limit < 0.5 * math.pi:
        raise InitialGuessError(
            f"hybrid_a_star: steering_limit = {steering_limit}; expected radians between 0 and pi / 2."
        )
    if not (math.isfinite(clearance) and clearance >= 0.0):
        raise InitialGuessError(f"hybrid_a_star: clearance = {clearance}; expected a length that is not negative.")


def _checked_pose(pose: Sequence[float], which: str, trailer: Trailer | None) -> Array:
    """Three finite numbers; four with a trailer, which is not bent beyond its limit."""
    numbers = np.array(pose, dtype=float)
    wanted = "three finite numbers (x, y, heading)"
    if trailer is not None:
        wanted = "four finite numbers (x, y, heading, heading of the trailer less that of the car)"
    if numbers.shape != (3 if trailer is None else 4,) or not np.isfinite(numbers).all():
        raise InitialGuessError(f"hybrid_a_star: the {which} is {pose!r}; expected {wanted}.")
    if trailer is not None and not trailer.are_within(numbers):
        raise InitialGuessError(
            f"hybrid_a_star: at the {which} the angle between trailer and car is {numbers[3]:.6g}, beyond its limit of "
            f"{trailer.limit:.6g} to either side. Straighten it there, or widen the limit."
        )
    return numbers


def _checked_bounds(bounds: Bounds) -> Bounds:
    """Two finite intervals that are not empty."""
    numbers = np.array(bounds, dtype=float)
    if numbers.shape != (2, 2) or not np.isfinite(numbers).all() or (numbers[:, 0] >= numbers[:, 1]).any():
        raise InitialGuessError(
            f"hybrid_a_star: bounds = {bounds!r}; expected ((x_min, x_max), (y_min, y_max)), finite."
        )
    (left, right), (bottom, top) = numbers.tolist()
    return (left, right), (bottom, top)


def _check_end(
    pose: Array, which: str, body: Polytope, obstacles: list[Polytope], bounds: Bounds | None, clearance: float
) -> None:
    """Refuse an end out of bounds or too close to an obstacle, by the exact distance, independently of the search."""
    for axis, (low, high) in enumerate(bounds or ()):
        if not low <= pose[axis] <= high:
            raise InitialGuessError(
                f"hybrid_a_star: the {which} has {'xy'[axis]} = {pose[axis]:g}, out of the bounds from {low:g} to "
                f"{high:g}. Widen the bounds, or move the {which}."
            )
    for obstacle in obstacles:
        distance = signed_distance(body, obstacle, planar_pose(*pose[:3].tolist())).distance
        if distance < clearance - 1e-9:
            how = f"overlaps it by {-distance:.6g}" if distance < 0 else f"is only {distance:.6g} away from it"
            raise InitialGuessError(
                f"hybrid_a_star: at the {which} ({pose[0]:g}, {pose[1]:g}, {pose[2]:g}) '{body.name}' collides with "
                f"'{obstacle.name}': it {how}, and a clearance of {clearance:g} is required. Move the {which}, or ask "
                "for less."
            )
