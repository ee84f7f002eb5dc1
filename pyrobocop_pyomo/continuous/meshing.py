"""From a continuous set and the user's wishes to a grid; no point is ever rounded or moved."""

from __future__ import annotations

import heapq
import logging
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from pyrobocop_pyomo.errors import MeshError
from pyrobocop_pyomo.numerics import Grid, Mesh, Scheme

logger = logging.getLogger(__name__)

# Boundaries that are meant to be equal but were computed in two ways would enclose an element of no width.
LEAST_WIDTH = 1e-9


def make_grid(domain: Any, points: Sequence[float], scheme: Scheme, elements: int, mesh: Any = None) -> Grid:
    """The grid of a scheme on a continuous set.

    Parameters
    ----------
    domain : ContinuousSet
        Named in messages.
    points : sequence of float
        The points that the user gave the set; all of them become element boundaries.
    scheme : Scheme
    elements : int
        Number of elements; more where the points ask for more.
    mesh : sequence of float, optional
        Boundaries to use instead of ``elements``.

    Raises
    ------
    MeshError
        When the mesh does not fit the set.
    """
    points = [float(point) for point in points]
    if mesh is None:
        return Grid(scheme, Mesh(tuple(_refined(domain, points, elements))))
    boundaries = sorted({*(float(value) for value in Mesh.given(mesh).boundaries), *points})
    what = f"'{domain.name}'"
    for given, own in ((mesh[0], points[0]), (mesh[-1], points[-1])):
        if float(given) != own:
            raise MeshError(f"{what}: the mesh ends at {given:g}, but the set ends at {own:g}. Make them equal.")
    for left, right in pairwise(boundaries):
        if right - left < LEAST_WIDTH * (boundaries[-1] - boundaries[0]):
            raise MeshError(
                f"{what}: the boundaries {left!r} and {right!r} are closer than anything that can be meant; one is a "
                "point of the set, the other of the mesh. Use the same number in both."
            )
    return Grid(scheme, Mesh(tuple(boundaries)))


def _refined(domain: Any, points: Sequence[float], elements: int) -> list[float]:
    """The points, and between them as many more as elements are missing: equal parts, the widest gap first."""
    given = len(points) - 1
    if given > elements:
        logger.warning(
            "'%s': has %d points of its own, hence %d elements instead of %d", domain.name, given + 1, given, elements
        )
    gaps = [(-(right - left), i, 1) for i, (left, right) in enumerate(pairwise(points))]
    heapq.heapify(gaps)
    parts = [1] * given
    for _ in range(elements - given):
        _, i, count = heapq.heappop(gaps)
        parts[i] = count + 1
        heapq.heappush(gaps, (-(points[i + 1] - points[i]) / (count + 1), i, count + 1))
    boundaries = [float(points[0])]
    for i, count in enumerate(parts):
        boundaries += Mesh.uniform(points[i], points[i + 1], count).boundaries[1:]
    return boundaries
