"""A path for a car among obstacles, to start a solver from: hybrid A* from the tight end outwards.

The goal is where it is tight, as a rule. Seen from the start every way into a slot looks alike until the last move;
seen from the goal there are few ways out, and in the open the shortest way of a car without obstacles ends the search
exactly. A car that rolls back along its path needs the same steering, so that a path found backwards is a path.

Where the start is tight too, the search from the goal runs long; where an end is so tight that the moves lead nowhere,
it is soon over. So two searches take turns, the goal's first, each with more poses in its next turn, or with finer
moves when it was used up.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import GuessError
from pyrobocop_pyomo.geometry import Polytope

from .car_checks import check_car, check_end, checked_bounds, checked_pose, named_obstacles
from .car_moves import CarMoves, CarSearch
from .car_path import CarPath
from .free_space import FreeSpace
from .outward_search import OutwardSearch, SearchEnd
from .rolling import rolled_on
from .way_estimates import Bounds, WayEstimates

Array = NDArray[np.float64]

# Poses that a search may keep in its first turn, and how many times more in each later one.
FIRST_BUDGET = 6_000
GROWTH = 2
EAGERNESS_FROM_START = 2.0


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
    time_limit: float = 60.0,
) -> CarPath:
    """Path of a car that keeps its clearance all along, proven between its poses as well.

    Parameters
    ----------
    start, goal : (x, y, heading)
        Of the middle of the rear axle; headings in radians.
    body : Polytope
        The car in its own frame: origin in the middle of the rear axle, x ahead. Bounded, in the plane.
    obstacles : dict of str to Polytope, or sequence
        May be without end (walls, wedges). Those of a sequence are called "obstacle 1", ...
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
        Seconds.

    Returns
    -------
    CarPath
        The same whenever it is asked for.

    Raises
    ------
    GuessError
        When start or goal are out of bounds or too close to an obstacle (which is named, with its distance), and when
        no path is found.
    """
    began = time.monotonic()
    options = CarSearch() if search is None else search
    shapes = named_obstacles(obstacles)
    ends = {"goal": checked_pose(goal, "goal"), "start": checked_pose(start, "start")}
    check_car(body, shapes, wheelbase, steering_limit, clearance, time_limit)
    limits = checked_bounds(bounds)
    for which, pose in ends.items():
        check_end(pose, which, body, shapes, limits, clearance)
    if np.array_equal(ends["start"], ends["goal"]):
        raise GuessError("hybrid_a_star: start and goal are the same pose; there is no path to find.")
    scene = body.reach + float(np.abs([*limits[0], *limits[1]]).max())
    scene += max((float(np.abs(each.vertices).max()) for each in shapes), default=0.0)
    space = FreeSpace.around(body, shapes, clearance, scene)
    coarse = CarMoves.of(wheelbase, steering_limit, options)

    def begun(which: str, estimates: WayEstimates, level: int) -> OutwardSearch:
        moves = CarMoves.of(wheelbase, steering_limit, options, level)
        # The second search is for hard cases, where any path will do.
        eagerness = options.eagerness * (1.0 if which == "goal" else EAGERNESS_FROM_START)
        return OutwardSearch(ends[which], limits, moves, eagerness, space, estimates)

    turns: list[_Turns] = []
    budget = FIRST_BUDGET
    while True:
        for k, (which, other) in enumerate((("goal", "start"), ("start", "goal"))):
            if k == len(turns):
                estimates = WayEstimates.to(ends[other], limits, body, shapes, clearance, coarse, scene)
                _check_disc(ends[which], estimates)
                turns.append(_Turns(which, begun(which, estimates, 0)))
            each = turns[k]
            end = each.search.run(min(budget, options.most_nodes), began + time_limit)
            while end is SearchEnd.USED_UP and each.level < options.refinements:
                each.level += 1
                each.search = begun(which, each.search.estimates, each.level)
                end = each.search.run(min(budget, options.most_nodes), began + time_limit)
            if end is SearchEnd.FOUND:
                return _path(ends["start"], ends["goal"], *each.search.steps(), wheelbase, outwards=which == "goal")
            if end is SearchEnd.USED_UP:
                raise GuessError(
                    f"hybrid_a_star: no path was found: from the {which}, {len(each.search.poses)} poses can be "
                    f"reached, none of which leads on. Try CarSearch(refinements={options.refinements + 1}), less "
                    "clearance, or wider bounds."
                )
        if time.monotonic() > began + time_limit or budget >= options.most_nodes:
            reached = " and ".join(f"{len(each.search.poses)} from the {each.which}" for each in turns)
            raise GuessError(
                f"hybrid_a_star: no path was found within {time_limit:g} seconds and {options.most_nodes} poses per "
                f"search; reached were {reached}. Give more time, CarSearch(most_nodes=...), a coarser cell, or less "
                "clearance."
            )
        budget *= GROWTH


@dataclass(eq=False)
class _Turns:
    """One of the two searches, as far as it has come."""

    which: str
    search: OutwardSearch
    level: int = 0


def _check_disc(root: Array, estimates: WayEstimates) -> None:
    if math.isinf(estimates.disc_length(root[None])[0]):
        raise GuessError(
            "hybrid_a_star: there is no path from start to goal: the obstacles and bounds leave no way even for a disc "
            "inside the car. Move an obstacle, widen the bounds or ask for less clearance."
        )


def _path(start: Array, goal: Array, ways: Array, curvatures: Array, wheelbase: float, *, outwards: bool) -> CarPath:
    """The path from the start to the goal along arcs found from one of them; outwards: from the goal."""
    poses = rolled_on(goal if outwards else start, ways, curvatures)
    if outwards:
        poses, ways, curvatures = poses[::-1].copy(), -ways[::-1], curvatures[::-1]
        poses[:, 2] += start[2] - poses[0, 2]
    # The ends exactly, up to whole turns: what is taken off is the rounding of the way there.
    poses[0] = start
    poses[-1] = goal[0], goal[1], goal[2] + 2.0 * math.pi * round((poses[-1, 2] - goal[2]) / (2.0 * math.pi))
    directions, steering = np.sign(ways), np.arctan(wheelbase * curvatures)
    return CarPath(poses, np.append(directions, directions[-1]), np.append(steering, steering[-1]))
