"""Hybrid A* again and again until its expansions are used: more room, coarser and finer cells, less clearance."""

from __future__ import annotations

import enum
import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from pyrobocop_pyomo.errors import InitialGuessError, PathNotFound
from pyrobocop_pyomo.modeling.deadline import Deadline

from .car_kinematics import Trailer
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
# Divisors of the cells from the beginning. Coarse cells lead round what fine ones would have to be driven through with
# many cusps.
COARSE, FINER = 0.25, 2.0
# Of the expansions and the time that are left: what one search may take, and what the first ones may.
SHARE, LITTLE = 0.4, 0.15
# Paths with more cusps are compared with one that leads round, where a cusp counts as so many turning radii: a car that
# stops, turns its wheels and accelerates could have driven that far.
FEW_CUSPS, CUSP = 4, 2.0


class _Failure(enum.Enum):
    """Why a search found nothing."""

    CLOSED = enum.auto()  # an end collides, or not even a disc has a way
    EXHAUSTED = enum.auto()
    LIMIT = enum.auto()


@dataclass(frozen=True, eq=False)
class StagedPath:
    """A path, and what it was found with.

    Attributes
    ----------
    path : CarPath
    clearance : float
        That it keeps.
    bounds : ((x_min, x_max), (y_min, y_max))
    """

    path: CarPath
    clearance: float
    bounds: Bounds


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
) -> StagedPath:
    """A path with as much of the clearance as possible, and the first one found unless it has many cusps.

    Parameters
    ----------
    regions : sequence of bounds
        The next one is tried where the one before has no path.
    clearance : float
    shares : sequence of float
        Of the clearance; the next one is tried where no path keeps the one before.
    search : CarSearch, optional
        Its expansions are for all searches together.
    time_limit : float, optional
        Seconds, for all searches together.
    **car
        The others are those of `hybrid_a_star`.

    Raises
    ------
    InitialGuessError
        When there is none: what the first search says.
    """
    given = CarSearch() if search is None else search
    radius = car["wheelbase"] / math.tan(car["steering_limit"])
    expansions, deadline = given.max_expansions, Deadline.after(time_limit)
    first: InitialGuessError | None = None

    def attempt(needed: float, bounds: Bounds, divisor: float, part: float) -> StagedPath | _Failure:
        nonlocal expansions, first
        if first is not None and (expansions <= 0 or deadline.has_passed):
            return _Failure.LIMIT
        most = max(1, round(part * expansions))
        limit = None if deadline.left is None else max(part * deadline.left, 1e-9)
        until = Deadline.after(limit)
        search = replace(_with_cells(given, divisor, radius, car.get("trailer")), max_expansions=most)
        try:
            path = hybrid_a_star(start, goal, bounds=bounds, clearance=needed, search=search, time_limit=limit, **car)
            return StagedPath(path, needed, bounds)
        except InitialGuessError as error:
            logger.info("a clearance of %.4g, cells divided by %g: %s", needed, divisor, error)
            first = error if first is None else first
            spent = error.expansions if isinstance(error, PathNotFound) else 0
        expansions -= spent
        if spent >= most or until.has_passed:
            return _Failure.LIMIT
        return _Failure.EXHAUSTED if spent else _Failure.CLOSED

    for needed in (share * clearance for share in shares):
        near = attempt(needed, regions[0], 1.0, LITTLE)
        if isinstance(near, StagedPath) and near.path.cusps <= FEW_CUSPS:
            return near
        around = attempt(needed, regions[-1], COARSE, LITTLE)
        found = [path for path in (near, around) if isinstance(path, StagedPath)]
        if found:
            return min(found, key=lambda one: one.path.length + CUSP * radius * one.path.cusps)
        for bounds in regions:
            # A limit that is reached says that there is a lot to reach, and neither more room nor finer cells make it
            # less.
            last = near if near is not _Failure.LIMIT and bounds == regions[0] else attempt(needed, bounds, 1.0, SHARE)
            if last is _Failure.EXHAUSTED:
                last = attempt(needed, bounds, FINER, SHARE)
            if isinstance(last, StagedPath):
                return last
            if last is _Failure.LIMIT:
                break
    assert first is not None
    raise first


def _with_cells(search: CarSearch, divisor: float, radius: float, trailer: Trailer | None) -> CarSearch:
    """Other cells and headings; where they are finer, more steering angles, which matter in narrow places too."""
    if divisor == 1.0:
        return search
    cell, headings = search.cells(radius, trailer)
    return replace(
        search, cell=cell / divisor, headings=max(8, round(divisor * headings)),
        steerings=2 * search.steerings - 1 if divisor > 1.0 else search.steerings,
    )  # fmt: skip
