"""Hybrid A* again and again until its expansions are used: more room, coarser cells, less clearance."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from pyrobocop_pyomo.errors import InitialGuessError, PathNotFound
from pyrobocop_pyomo.modeling.deadline import Deadline

from .car_path import CarPath
from .cost_to_go import Bounds
from .hybrid_a_star import hybrid_a_star
from .motion_primitives import CarSearch

logger = logging.getLogger(__name__)

# Sizes of the car by which it may go beyond start and goal; the next one where there is no path.
ROOM = (3.0, 8.0)
# Of the clearance that was asked for, one after the other: each is this share of the one before.
LESS = 0.6
CLEARANCES = tuple(LESS**k for k in range(5))
# How much coarser cells are where a way round is looked for, which fine ones would have to be driven through with
# many cusps.
COARSER = 4.0
# Of the expansions and the time that are left: what one search may take, and what the first ones may.
SHARE, LITTLE = 0.4, 0.15
# Paths with more cusps are compared with one that leads round, where a cusp counts as so many turning radii: a car that
# stops, turns its wheels and accelerates could have driven that far.
FEW_CUSPS, CUSP = 4, 2.0


def staged_search(
    start: Sequence[float],
    goal: Sequence[float],
    *,
    regions: Sequence[Bounds],
    clearance: float,
    shares: Sequence[float] = CLEARANCES,
    search: CarSearch | None = None,
    time_limit: float | None = None,
    **car: Any,
) -> tuple[CarPath, float, Bounds]:
    """A path with as much of the clearance as possible, and the first one found unless it has many cusps.

    Parameters
    ----------
    regions : sequence of bounds
        The first is tried first, then the last.
    clearance : float
    shares : sequence of float
        Of the clearance; the next one is tried where no path keeps the one before.
    search : CarSearch, optional
        Its expansions are for all searches together.
    time_limit : float, optional
        Seconds, for all searches together.
    **car
        The others as for `hybrid_a_star`.

    Returns
    -------
    path : CarPath
    clearance : float
        That it keeps.
    bounds : ((x_min, x_max), (y_min, y_max))
        In which it was searched.

    Raises
    ------
    InitialGuessError
        When there is none: what the first search says.
    """
    given = CarSearch() if search is None else search
    radius = car["wheelbase"] / math.tan(car["steering_limit"])
    expansions, deadline = given.max_expansions, Deadline.after(time_limit)
    first: InitialGuessError | None = None

    def attempt(needed: float, bounds: Bounds, coarser: float, part: float) -> tuple[CarPath, float, Bounds] | None:
        nonlocal expansions, first
        if first is not None and (expansions <= 0 or deadline.has_passed):
            return None
        most = max(1, round(part * expansions))
        limit = None if deadline.left is None else max(part * deadline.left, 1e-9)
        cell, headings = given.cells(radius, car.get("trailer"))
        search = replace(given, cell=coarser * cell, headings=max(8, round(headings / coarser)), max_expansions=most)
        try:
            path = hybrid_a_star(start, goal, bounds=bounds, clearance=needed, search=search, time_limit=limit, **car)
            return path, needed, bounds
        except InitialGuessError as error:
            logger.info("a clearance of %.4g, cells %g times as large: %s", needed, coarser, error)
            first = error if first is None else first
            expansions -= error.expansions if isinstance(error, PathNotFound) else 0
            return None

    for needed in (share * clearance for share in shares):
        near = attempt(needed, regions[0], 1.0, LITTLE)
        if near is not None and near[0].cusps <= FEW_CUSPS:
            return near
        found = [path for path in (near, attempt(needed, regions[-1], COARSER, LITTLE)) if path is not None]
        if found:
            return min(found, key=lambda one: one[0].length + CUSP * radius * one[0].cusps)
        last = attempt(needed, regions[-1], 1.0, SHARE)
        if last is not None:
            return last
    assert first is not None
    raise first
