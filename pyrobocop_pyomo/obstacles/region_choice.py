"""Which interval of a motion is inside which of several convex regions: dynamic programming along time."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.numerics import Array, BoolArray
from pyrobocop_pyomo.optional_imports import scipy

# Relative to the size of the body: what room is worth, and what a change of region costs.
_PREFERENCE = 1e-3
# How much more counts what no plan can repair: a fixed pose that is outside, an overlap that is too narrow.
_FIXED = 1e2
# At so many rotations along the motion the overlaps are measured.
_ROTATIONS = 8


def choose_regions(
    cells: Sequence[Sequence[int]],
    rooms: Array,
    extents: Sequence[Array],
    regions: Sequence[Polytope],
    clearance: float,
    size: float,
    fixed: BoolArray,
) -> tuple[list[int], float]:
    """Region of each cell with the least violation along time, such that the body fits where they change.

    Parameters
    ----------
    cells : sequence of sequence of int
        Positions of the times of each cell; consecutive cells that share their time are connected.
    rooms : array, shape (times, regions)
        Distance to the nearest side, negative outside.
    extents : sequence of array, each of shape (times, sides)
        By region: how far the body reaches beyond the origin of its frame along each outward normal.
    regions : sequence of Polytope
    clearance : float
    size : float
        Of the body.
    fixed : array, shape (times,)
        Where the place is fixed, which no plan moves into another region.

    Returns
    -------
    choice : list of int
        One region per cell.
    misfit : float
        How much too small the overlaps are where regions change; 0 where the body fits into all.
    """
    lacking = np.where(fixed[:, None], _FIXED, 1.0) * np.maximum(clearance - rooms, 0.0) / size
    worth = _PREFERENCE * np.minimum(rooms, size) / size
    costs = [(lacking[list(cell)] ** 2 - worth[list(cell)]).mean(axis=0) for cell in cells]
    fits = _Overlaps(regions, extents, clearance)
    total, origins, passages = costs[0], [], []
    for before, cell, cost in zip(cells, cells[1:], costs[1:], strict=False):
        joined = before[-1] == cell[0]
        misfit = fits.at(cell[0]) if joined else np.zeros((len(regions), len(regions)))
        change = _PREFERENCE * (1.0 - np.eye(len(regions))) + (_FIXED * misfit / size) ** 2
        step = total[:, None] + change
        origins.append(step.argmin(axis=0))
        passages.append(misfit)
        total = step.min(axis=0) + cost
    choice = [int(total.argmin())]
    for origin in reversed(origins):
        choice.append(int(origin[choice[-1]]))
    choice.reverse()
    misfits = [float(misfit[a, b]) for misfit, a, b in zip(passages, choice, choice[1:], strict=False)]
    return choice, max(misfits, default=0.0)


class _Overlaps:
    """How much a body misses to fit into the overlap of two regions, at the rotations of a motion."""

    def __init__(self, regions: Sequence[Polytope], extents: Sequence[Array], clearance: float) -> None:
        self._regions, self._extents, self._clearance = regions, extents, clearance
        times = len(extents[0])
        self._sampled = np.unique(np.linspace(0, times - 1, _ROTATIONS).round().astype(int))
        self._known: dict[int, Array] = {}
        nothing = [np.zeros(extent.shape[1]) for extent in extents]
        self._apart = self._misfits(nothing, 0.0, np.zeros((len(regions), len(regions)), dtype=bool))

    def at(self, time: int) -> Array:
        """Misfits of all pairs of regions at the sampled rotation nearest to a time, shape (regions, regions)."""
        nearest = int(self._sampled[np.abs(self._sampled - time).argmin()])
        if nearest not in self._known:
            extents = [extent[nearest] for extent in self._extents]
            same = next((k for k in self._known if self._equal(k, nearest)), None)
            apart = self._apart > 0.0
            self._known[nearest] = self._misfits(extents, self._clearance, apart) if same is None else self._known[same]
        return self._known[nearest]

    def _equal(self, first: int, second: int) -> bool:
        return all(np.allclose(extent[first], extent[second]) for extent in self._extents)

    def _misfits(self, extents: Sequence[Array], clearance: float, apart: BoolArray) -> Array:
        count = len(self._regions)
        misfits = np.zeros((count, count))
        for a in range(count):
            for b in range(a):
                if apart[a, b]:
                    # Regions that do not meet: the body misses at least what a point does.
                    misfits[a, b] = misfits[b, a] = self._apart[a, b]
                    continue
                sides = [self._regions[k].halfspaces for k in (a, b)]
                rows = np.vstack([normals for normals, _ in sides])
                limits = np.concatenate([offsets - extents[k] for (_, offsets), k in zip(sides, (a, b), strict=True)])
                misfits[a, b] = misfits[b, a] = _least_violation(rows, limits - clearance)
        return misfits


def _least_violation(rows: Array, limits: Array) -> float:
    """Least ``s >= 0`` for which a point has ``rows x <= limits + s``."""
    dimension = rows.shape[1]
    found = scipy.optimize.linprog(
        np.append(np.zeros(dimension), 1.0),
        A_ub=np.hstack([rows, -np.ones((len(rows), 1))]),
        b_ub=limits,
        bounds=[(None, None)] * dimension + [(0.0, None)],
    )
    return float(found.x[-1]) if found.success else 0.0


def shifted_changes(
    cells: Sequence[Sequence[int]], choice: Sequence[int], rooms: Array, places: Array, active: float
) -> list[int]:
    """The choice with changes of region moved along time, where the motion presses against sides there.

    At the time of a change the body is in both regions. Where it touches a side of the region that it leaves and none
    of the other, it would leave earlier; and the other way round. Where it touches both, as at the inner corner of a
    bend, its place is given and its time is not: the change moves towards equal speeds before and after.

    Parameters
    ----------
    cells, choice, rooms
        As for `choose_regions`, at a solution.
    places : array, shape (times, d)
        Of the body.
    active : float
        Room up to which a side is touched.
    """
    starts = [0, *(k + 1 for k, (a, b) in enumerate(itertools.pairwise(choice)) if a != b)]
    runs = list(zip(starts, [*starts[1:], len(choice)], strict=True))
    lengths = [
        sum(float(np.linalg.norm(places[cell[-1]] - places[cell[0]])) for cell in cells[start:end])
        for start, end in runs
    ]
    changed = list(choice)
    for number, (before, after) in enumerate(itertools.pairwise(runs)):
        last, first = before[1] - 1, after[0]
        if cells[last][-1] != cells[first][0]:
            continue
        leaving, entering = rooms[cells[first][0], [choice[last], choice[first]]] <= active
        counts = before[1] - before[0], after[1] - after[0]
        if leaving and entering:
            whole = max(lengths[number] + lengths[number + 1], 1e-300)
            wanted = sum(counts) * lengths[number] / whole - counts[0]
            # Half the way, since the changes before and after move as well.
            later = round(wanted / 2) or (round(wanted) if abs(wanted) >= 0.75 else 0)
        else:
            later = int(entering) - int(leaving)
        if later > 0:
            later = min(later, counts[1] - 1)
            changed[first : first + later] = [choice[last]] * later
        elif later < 0:
            earlier = min(-later, counts[0] - 1)
            changed[first - earlier : first] = [choice[first]] * earlier
    return changed
