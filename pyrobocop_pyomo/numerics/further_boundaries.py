"""Further boundaries of a mesh: at given times, and where delays lead from boundary to boundary."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from .mesh import Mesh


def mesh_with(mesh: Mesh, times: Iterable[float]) -> Mesh:
    """A mesh with further boundaries at given times inside of it."""
    first, last = mesh.boundaries[0], mesh.boundaries[-1]
    inside = {time for time in times if first < time < last}
    return mesh if inside <= set(mesh.boundaries) else Mesh(tuple(sorted({*mesh.boundaries, *inside})))


def mesh_of_delays(mesh: Mesh, delays: Sequence[float], most: int) -> Mesh:
    """A mesh that each delay moves onto itself, as far as it goes, if the given one is uniform and none is so yet.

    Where the motion has a kink it has one again a delay later; and values at earlier times are values at points then.

    Parameters
    ----------
    mesh : Mesh
    delays : sequence of float
        Positive.
    most : int
        Elements, of which there are no more; otherwise the mesh stays.
    """
    widths, start, end = mesh.widths, mesh.boundaries[0], mesh.boundaries[-1]
    horizon = end - start
    if not delays or widths.max() - widths.min() > 1e-9 * horizon:
        return mesh
    period = _common_part(delays, horizon / most)
    if period is None or period >= horizon:
        return mesh
    windows = math.floor(horizon / period + 1e-9)
    rest = horizon - windows * period
    rest = 0.0 if rest < 1e-9 * horizon else rest
    places: list[float] = []
    for left, right in ((0.0, rest), (rest, period)):
        parts = math.ceil((right - left) / float(widths.max()) - 1e-9)
        places += [left + (right - left) * k / parts for k in range(parts)]
    inner = [start + window * period + place for window in range(windows + 1) for place in places]
    boundaries = [time for time in inner if start < time < end - 1e-9 * horizon]
    made = Mesh((start, *boundaries, end))
    same = made.elements == mesh.elements and np.allclose(made.boundaries, mesh.boundaries, atol=1e-9 * horizon)
    return mesh if same or made.elements > most else made


def _common_part(delays: Sequence[float], least: float) -> float | None:
    """The largest time of which all delays are multiples; None where that is below the least."""
    found: float = delays[0]
    for delay in delays[1:]:
        one, other = found, delay
        while other > 1e-9 * found:
            one, other = other, math.fmod(one, other)
            other = 0.0 if one - other < 1e-9 * found else other
            if one < least:
                return None
        found = one
    return found if found >= least else None
