"""From the errors of elements to a better mesh: split where they are large, join where they are small."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .mesh import Mesh
from .rounding import NEGLIGIBLE, ROUNDING

# A split aims below the tolerance and a join further below, so that the next estimate seldom calls for the contrary.
_AIM_OF_SPLITTING = 0.5
_AIM_OF_JOINING = 0.05
# A boundary moves over this part of an element at most.
_NEAR = 0.2


def remesh(
    mesh: Mesh,
    errors: ArrayLike,
    tolerance: float,
    order: int,
    *,
    most_parts: int = 4,
    keep: Collection[float] | None = None,
    jumps: Mapping[int, float] | None = None,
) -> Mesh:
    """A mesh whose elements are expected to meet a tolerance.

    With the local error ``e = C h^(order + 1)``, an element whose error exceeds the tolerance is split into
    ``ceil((e / aim)^(1 / (order + 1)))`` equal parts, and neighbours whose union is expected far below the tolerance
    are joined.

    Parameters
    ----------
    mesh : Mesh
    errors : array, shape (N,)
        Per element; infinite ones count as very large.
    tolerance : float
    order : int
        Of the scheme, at element ends.
    most_parts : int
        Into which one element is split at once: far from its asymptotic order an error says little.
    keep : collection of float, optional
        Boundaries that stay; all of them by default, so that nothing is joined.
    jumps : mapping of int to float, optional
        Local fractions at which elements are split in two instead of equal parts. A boundary that need not stay and is
        near to such a place moves there.
    """
    found = np.maximum(np.asarray(errors, dtype=float), ROUNDING)
    tolerance = max(tolerance, ROUNDING)  # no mesh is better than that
    # Beside a singularity elements would become ever narrower, and errors no smaller.
    narrowest = NEGLIGIBLE * (mesh.boundaries[-1] - mesh.boundaries[0])
    found = np.where(np.array(mesh.widths) > narrowest, found, np.minimum(found, tolerance))
    power = 1.0 / (order + 1)
    fixed = set(mesh.boundaries) if keep is None else set(keep)
    boundaries = [mesh.boundaries[0]]
    i = 0
    while i < mesh.elements:
        start, end = mesh.boundaries[i : i + 2]
        if found[i] > tolerance and jumps is not None and i in jumps:
            at = start + jumps[i] * (end - start)
            if jumps[i] < _NEAR and start not in fixed and boundaries[-1] == start:
                boundaries.pop()
            boundaries.append(at)
            if jumps[i] > 1.0 - _NEAR and end not in fixed and found[i + 1] <= tolerance:
                i += 1
                end = mesh.boundaries[i + 1]
        elif found[i] > tolerance:
            ratio = (found[i] / (_AIM_OF_SPLITTING * tolerance)) ** power
            parts = most_parts if not math.isfinite(ratio) else min(most_parts, max(2, math.ceil(ratio)))
            boundaries += [start + (end - start) * k / parts for k in range(1, parts)]
        elif i + 1 < mesh.elements and end not in fixed and _can_join(mesh, found, i, tolerance, power):
            i += 1
            end = mesh.boundaries[i + 1]
        boundaries.append(end)
        i += 1
    return Mesh(tuple(boundaries))


def halves_of(mesh: Mesh) -> Mesh:
    """The mesh with each element in two."""
    return remesh(mesh, np.full(mesh.elements, np.inf), 1.0, 1, most_parts=2)


def _can_join(mesh: Mesh, errors: NDArray[np.float64], i: int, tolerance: float, power: float) -> bool:
    """True when the union of an element and the next is expected to stay far below the tolerance."""
    union = mesh.widths[i] + mesh.widths[i + 1]
    expected = max(errors[k] * (union / mesh.widths[k]) ** (1.0 / power) for k in (i, i + 1))
    return bool(expected <= _AIM_OF_JOINING * tolerance)
