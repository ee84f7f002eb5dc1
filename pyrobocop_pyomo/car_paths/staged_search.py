"""Hybrid A* again and again until its time is used: with more room, less clearance, and finer cells."""

from __future__ import annotations

import itertools
import logging
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.geometry import Polytope

from .car_kinematics import Trailer
from .car_path import CarPath
from .cost_to_go import Bounds
from .hybrid_a_star import hybrid_a_star
from .motion_primitives import CELL, CarSearch

logger = logging.getLogger(__name__)

# Of the clearance that was asked for, one after the other.
CLEARANCES = (1.0, 0.6, 0.4, 0.2, 0.1)
# Divisors of the cells from the beginning.
FINER = (1, 2)
# Of the time that is left: what one search may take.
SHARE = 0.4


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
    body: Polytope,
    obstacles: Mapping[str, Polytope],
    wheelbase: float,
    steering_limit: float,
    regions: Sequence[Bounds],
    clearance: float,
    search: CarSearch | None = None,
    time_limit: float,
    trailer: Trailer | None = None,
) -> StagedPath:
    """The first path that is found, with as much of the clearance as possible.

    Parameters
    ----------
    regions : sequence of bounds
        The next one is tried where the one before has no path.
    clearance : float
        Where no path keeps it, a path that keeps a part of it is searched for.
    time_limit : float
        Seconds, for all searches together.

    The others are those of `hybrid_a_star`.

    Raises
    ------
    InitialGuessError
        When there is none: what the first search says.
    """
    given = CarSearch() if search is None else search
    radius = wheelbase / math.tan(steering_limit)
    deadline = time.monotonic() + time_limit
    first: InitialGuessError | None = None
    for share in CLEARANCES:
        for bounds, finer in itertools.product(regions, FINER):
            began = time.monotonic()
            left = deadline - began
            if left <= 0.0 and first is not None:
                raise first
            limit = max(SHARE * left, 1e-9)
            try:
                path = hybrid_a_star(
                    start,
                    goal,
                    body=body,
                    obstacles=obstacles,
                    wheelbase=wheelbase,
                    steering_limit=steering_limit,
                    bounds=bounds,
                    clearance=share * clearance,
                    search=_finer(given, finer, radius),
                    time_limit=limit,
                    trailer=trailer,
                )
                return StagedPath(path, share * clearance, bounds)
            except InitialGuessError as error:
                logger.info("%.0f %% of the clearance, cells divided by %d: %s", 100.0 * share, finer, error)
                first = error if first is None else first
            if time.monotonic() - began >= limit:
                # There is a lot to reach, and neither more room nor finer cells make it less.
                break
    assert first is not None
    raise first


def _finer(search: CarSearch, divisor: int, radius: float) -> CarSearch:
    """Smaller cells and more headings; and more steering angles, which matter in narrow places as well."""
    if divisor == 1:
        return search
    cell = (CELL * radius if search.cell is None else search.cell) / divisor
    length = None if search.primitive_length is None else search.primitive_length / divisor
    headings, steerings = divisor * search.headings, 2 * search.steerings - 1
    return replace(search, cell=cell, primitive_length=length, headings=headings, steerings=steerings)
