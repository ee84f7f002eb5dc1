"""Hybrid A* again and again until its expansions are used: with more room, less clearance, and finer cells."""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pyrobocop_pyomo.errors import InitialGuessError, PathNotFound
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.modeling.deadline import Deadline

from .car_kinematics import Trailer
from .car_path import CarPath
from .cost_to_go import Bounds
from .hybrid_a_star import hybrid_a_star
from .motion_primitives import CarSearch

logger = logging.getLogger(__name__)

# Of the clearance that was asked for, one after the other.
CLEARANCES = (1.0, 0.6, 0.4, 0.2, 0.1)
# Divisors of the cells from the beginning.
FINER = (1, 2)
# Of the expansions and the time that are left: what one search may take.
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
    shares: Sequence[float] = CLEARANCES,
    search: CarSearch | None = None,
    time_limit: float | None = None,
    trailer: Trailer | None = None,
) -> StagedPath:
    """The first path that is found, with as much of the clearance as possible.

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

    The others are those of `hybrid_a_star`.

    Raises
    ------
    InitialGuessError
        When there is none: what the first search says.
    """
    given = CarSearch() if search is None else search
    radius = wheelbase / math.tan(steering_limit)
    expansions, deadline = given.max_expansions, Deadline.after(time_limit)
    first: InitialGuessError | None = None
    closed: Bounds | None = None
    for share in shares:
        for bounds, finer in itertools.product(regions, FINER):
            if first is not None and (expansions <= 0 or deadline.has_passed):
                raise first
            if finer > 1 and bounds == closed:
                continue
            most = max(1, round(SHARE * expansions))
            limit = None if deadline.left is None else max(SHARE * deadline.left, 1e-9)
            until = Deadline.after(limit)
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
                    search=replace(_finer(given, finer, radius, trailer), max_expansions=most),
                    time_limit=limit,
                    trailer=trailer,
                )
                return StagedPath(path, share * clearance, bounds)
            except InitialGuessError as error:
                logger.info("%.0f %% of the clearance, cells divided by %d: %s", 100.0 * share, finer, error)
                first = error if first is None else first
                spent = error.expansions if isinstance(error, PathNotFound) else 0
            expansions -= spent
            # Finer cells do not help where an end collides or nothing was expanded.
            closed = bounds if spent == 0 else None
            if spent >= most or until.has_passed:
                # There is a lot to reach, and neither more room nor finer cells make it less.
                break
    assert first is not None
    raise first


def _finer(search: CarSearch, divisor: int, radius: float, trailer: Trailer | None) -> CarSearch:
    """Smaller cells and more headings; and more steering angles, which matter in narrow places as well."""
    if divisor == 1:
        return search
    cell, headings = search.cells(radius, trailer)
    length = None if search.primitive_length is None else search.primitive_length / divisor
    return replace(
        search, cell=cell / divisor, primitive_length=length, headings=divisor * headings,
        steerings=2 * search.steerings - 1,
    )  # fmt: skip
