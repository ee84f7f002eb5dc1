"""What boxes prove about the clearances of all pairs at once, before any closest points are searched.

The boxes around what a shape sweeps in each interval are made once per shape, and compared for all pairs and intervals
in one operation. For pairs that are far apart in all intervals that is the whole proof; a reported distance is then
measured at a few instants of the interval in which the boxes are nearest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from pyrobocop_pyomo.geometry import distances_of_points
from pyrobocop_pyomo.numerics import Array, BoolArray, Indices
from pyrobocop_pyomo.numerics.interval_arithmetic import Interval

from .moving_shapes import MovingShape
from .required_clearance import RequiredClearance

_EPS = float(np.finfo(float).eps)
# Instants at which the distance of a far pair is measured, in one interval.
_INSTANTS = 9


def box_distances(a: Interval, b: Interval) -> Array:
    """Lower bounds of the distances of boxes (..., d); ``-inf`` where they meet or are unbounded."""
    gaps = np.maximum(np.maximum(a.low - b.high, b.low - a.high), 0.0)
    distances = np.linalg.norm(gaps, axis=-1) * (1.0 - 8 * _EPS)
    # Boxes that meet say nothing about the depth of an overlap.
    return np.where(distances > 0.0, distances, -np.inf)


class PairToProve(Protocol):
    """One pair of convex parts."""

    first: MovingShape
    second: MovingShape
    clearance: RequiredClearance


class BoxProofs:
    """Bounds of the excess of all pairs in all intervals, by boxes.

    Parameters
    ----------
    pairs : sequence of PairToProve
    intervals : int

    Attributes
    ----------
    bounds : array, shape (pairs, intervals)
        Lower bounds of the signed distance less the required clearance; ``-inf`` where boxes prove nothing.
    """

    def __init__(self, pairs: Sequence[PairToProve], intervals: int) -> None:
        self._pairs, self._intervals = pairs, intervals
        whole = np.arange(intervals), np.zeros(intervals), np.ones(intervals)
        shapes = {id(shape): shape for pair in pairs for shape in (pair.first, pair.second)}
        row = {key: k for k, key in enumerate(shapes)}
        boxes = [shape.boxes(*whole) for shape in shapes.values()]
        low, high = np.stack([box.low for box in boxes]), np.stack([box.high for box in boxes])
        first, second = (np.array([row[id(getattr(pair, side))] for pair in pairs]) for side in ("first", "second"))
        distances = box_distances(Interval(low[first], high[first]), Interval(low[second], high[second]))
        highest: dict[int, Array] = {}
        for pair in pairs:
            if id(pair.clearance) not in highest:
                highest[id(pair.clearance)] = pair.clearance.bounds(*whole).highest
        self.bounds = distances - np.stack([highest[id(pair.clearance)] for pair in pairs])
        self.bounds[np.isnan(self.bounds)] = -np.inf
        self._corners: dict[tuple[int, int], Array] = {}

    def far(self, needed: Array) -> BoolArray:
        """Which pairs are settled in all intervals, (pairs,); the excess `needed` is (pairs, intervals)."""
        return np.asarray((self.bounds >= np.maximum(needed, 0.0)).all(axis=1))

    def measured(self, chosen: Sequence[int]) -> Mapping[int, tuple[int, float, float]]:
        """Interval, fraction and excess of the closest of a few instants, for pairs without rays among the chosen."""
        fractions = np.linspace(0.0, 1.0, _INSTANTS)
        nearest = self.bounds.argmin(axis=1)
        alike: dict[tuple[int, int], list[int]] = {}
        for k in chosen:
            shapes = self._pairs[k].first.shape, self._pairs[k].second.shape
            if all(shape.is_bounded for shape in shapes):
                alike.setdefault((len(shapes[0].vertices), len(shapes[1].vertices)), []).append(k)
        found: dict[int, tuple[int, float, float]] = {}
        for members in alike.values():
            sides = [
                np.concatenate([self._at(getattr(self._pairs[k], side), int(nearest[k]), fractions) for k in members])
                for side in ("first", "second")
            ]
            finite = np.isfinite(sides[0]).all(axis=(1, 2)) & np.isfinite(sides[1]).all(axis=(1, 2))
            distances = np.full(len(finite), np.nan)
            distances[finite], _ = distances_of_points(sides[0][finite], sides[1][finite])
            for k, own in zip(members, distances.reshape(-1, _INSTANTS), strict=True):
                pair = self._pairs[k]
                at: Indices = np.full(_INSTANTS, nearest[k])
                excess = own - pair.first.shape.radius - pair.second.shape.radius - pair.clearance.values(at, fractions)
                if np.isfinite(excess).all():
                    least = int(excess.argmin())
                    found[k] = int(nearest[k]), float(fractions[least]), float(excess[least])
        return found

    def _at(self, shape: MovingShape, interval: int, fractions: Array) -> Array:
        key = (id(shape), interval)
        if key not in self._corners:
            self._corners[key], _ = shape.corners(np.full(len(fractions), interval), fractions)
        return self._corners[key]
