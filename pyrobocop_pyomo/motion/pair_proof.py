"""The proof for one pair: stretches of time, each proven clear by a plane, found too close, or halved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.geometry import distances_of_points

from .moving_shapes import MovingShape, Stretches
from .safety_report import PairSafety

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_EPS = float(np.finfo(float).eps)
# A ray that a normal meets by less than this does so by rounding, and counts as far as the scene reaches.
_ALONG_RAY = 1e-9
# Instants per level of the search for the closest one in an interval that is too close anyway.
_SEARCH = 17
# Intervals that are searched beside those: the closest instant of a motion is nearly always in one of them.
_SEARCHED = 3


@dataclass(frozen=True)
class Effort:
    """What one pair may cost; see `verify_clearance`."""

    tolerance: float
    depth: int
    pieces: int


def prove_pair(
    first: MovingShape, second: MovingShape, clearance: float, ends: Array, effort: Effort, strays: Array
) -> PairSafety:
    """Prove a clearance over all intervals.

    Parameters
    ----------
    first, second : MovingShape
    clearance : float
    ends : array, shape (intervals, 2)
        Start and end of each interval in the user's time.
    effort : Effort
    strays : array, shape (intervals,)
        How far the formulas misplace the two shapes together. Beyond the tolerance they are not those of a motion of
        rigid bodies: such intervals stay undecided.
    """
    with np.errstate(all="ignore"):  # what is not finite is never proven
        return _Proof(first, second, clearance, effort, len(ends)).run(ends, strays)


class _Proof:
    def __init__(
        self, first: MovingShape, second: MovingShape, clearance: float, effort: Effort, intervals: int
    ) -> None:
        self.first, self.second, self.clearance, self.effort = first, second, clearance, effort
        self.needed = clearance - effort.tolerance
        self.radii = first.shape.radius + second.shape.radius
        self.distance = np.full(intervals, np.nan)  # NaN: not looked into
        self.instant = np.full(intervals, 0.5)
        self.proven = np.full(intervals, np.inf)
        self.undecided: set[int] = set()
        self.pieces = 0

    def run(self, ends: Array, strays: Array) -> PairSafety:
        intervals = len(ends)
        interval = np.arange(intervals)
        start, end = np.zeros(intervals), np.ones(intervals)
        for level in range(self.effort.depth + 1):
            interval, start, end = self._level(interval, start, end, last=level == self.effort.depth)
            if len(interval) == 0:
                break
        self._search_closest()
        leaps = ~(strays <= self.effort.tolerance)
        self.proven[leaps] = -np.inf
        self.undecided.update(np.flatnonzero(leaps & ~(self.distance < self.needed)).tolist())
        worst = int(np.nanargmin(self.distance))
        begins, finishes = ends[worst]
        return PairSafety(
            first=self.first.name,
            second=self.second.name,
            clearance=self.clearance,
            tolerance=self.effort.tolerance,
            distance=float(self.distance[worst]),
            proven=float(self.proven.min()),
            time=float(begins + self.instant[worst] * (finishes - begins)),
            interval=worst,
            interval_distance=self.distance,
            interval_proven=self.proven,
            undecided=tuple(sorted(self.undecided)),
            pieces=self.pieces,
        )

    def _level(self, interval: Indices, start: Array, end: Array, last: bool) -> tuple[Indices, Array, Array]:
        """Judge stretches; returns the halves of those that are not decided."""
        self.pieces += len(interval)
        p = self.first.stretches(interval, start, end)
        q = self.second.stretches(interval, start, end)
        bound = self._box_distances(p, q)
        is_open = ~(bound >= self.clearance)
        chosen = np.flatnonzero(is_open)
        if len(chosen):
            if self.pieces == len(interval):
                # The ends of whole intervals; those of halves have been looked at as middles.
                self._look(interval[chosen], start[chosen])
                self._look(interval[chosen], end[chosen])
            middle = 0.5 * (start[chosen] + end[chosen])
            distances, normals = self._look(interval[chosen], middle)
            p, q = p.part(chosen), q.part(chosen)
            bound[chosen] = np.fmax(bound[chosen], self._plane_bounds(normals, p, q))
            # One plane for the middle has failed: the best one for both ends at once may not.
            hard = np.flatnonzero(~(bound[chosen] >= self.needed) & (distances >= self.needed))
            if len(hard):
                swept = self._swept_normals(p.part(hard), q.part(hard))
                again = self._plane_bounds(swept, p.part(hard), q.part(hard))
                bound[chosen[hard]] = np.fmax(bound[chosen[hard]], again)
        bound = np.where(np.isnan(bound), -np.inf, bound)
        violated = self.distance[interval] < self.needed
        open_ones = ~(bound >= self.needed) & ~violated
        gives_up = last or self.pieces + 2 * int(open_ones.sum()) > self.effort.pieces
        if gives_up:
            self.undecided.update(interval[open_ones].tolist())
        halved = np.zeros_like(open_ones) if gives_up else open_ones
        np.minimum.at(self.proven, interval[~halved], bound[~halved])
        middle = 0.5 * (start[halved] + end[halved])
        return (
            np.concatenate([interval[halved], interval[halved]]),
            np.concatenate([start[halved], middle]),
            np.concatenate([middle, end[halved]]),
        )

    def _look(self, interval: Indices, fraction: Array) -> tuple[Array, Array]:
        """Exact distances and normals at instants; the closest ones are remembered."""
        p, p_rays = self.first.corners(interval, fraction)
        q, q_rays = self.second.corners(interval, fraction)
        distances, normals = _exact(p, q, p_rays, q_rays)
        distances = distances - self.radii
        for i, distance, at in zip(interval.tolist(), distances.tolist(), fraction.tolist(), strict=True):
            # What is not finite is not seen: it must not hide what was.
            if distance < self.distance[i] or np.isnan(self.distance[i]):
                self.distance[i], self.instant[i] = distance, at
        return distances, normals

    def _swept_normals(self, p: Stretches, q: Stretches) -> Array:
        """Normals that separate best what both shapes cover at both ends, seen from the second shape."""
        moved = (q.at_end[0] - q.at_start[0])[:, :1, :]
        _, normals = _exact(
            np.concatenate([p.at_start[0], p.at_end[0] - moved], axis=1),
            np.concatenate([q.at_start[0], q.at_end[0] - moved], axis=1),
            np.concatenate([p.at_start[1], p.at_end[1]], axis=1),
            np.concatenate([q.at_start[1], q.at_end[1]], axis=1),
        )
        return normals

    def _plane_bounds(self, normals: Array, p: Stretches, q: Stretches) -> Array:
        """What a fixed direction proves about the signed distance during each stretch, shape ``(m,)``."""
        ends = []
        for corners_p, corners_q in ((p.at_start[0], q.at_start[0]), (p.at_end[0], q.at_end[0])):
            # Measured from one of the corners: scenes far from the origin lose no digits.
            origin = corners_q[:, :1, :]
            along_p = np.einsum("mr,mir->mi", normals, corners_p - origin)
            along_q = np.einsum("mr,mjr->mj", normals, corners_q - origin)
            ends.append(along_p[:, :, None] - along_q[:, None, :])
        p_bend, q_bend = p.bends(normals), q.bends(normals)
        bend = np.maximum(p_bend.high[:, :, None] - q_bend.low[:, None, :], 0.0)
        chord = np.minimum(ends[0], ends[1]) - p.sag_factor()[:, None, None] * bend
        # Where second derivatives have no bound, values may: a root that starts at zero, for example.
        values = p.values(normals).low[:, :, None] - q.values(normals).high[:, None, :]
        gap = np.fmax(chord, values).min(axis=(1, 2))
        # How far a normal leans over rays, and what that is worth as far away as the nearest points may be.
        leaning = np.maximum(-p.ray_slopes(normals).low.min(axis=1, initial=0.0), 0.0)
        leaning = np.maximum(leaning, q.ray_slopes(normals).high.max(axis=1, initial=0.0))
        gap = np.where(leaning <= _ALONG_RAY, gap - 4.0 * leaning * _reach(p, q), -np.inf)
        size = np.maximum(np.abs(ends[0]), np.abs(ends[1])).max(axis=(1, 2))
        # A gap along a vector of any length is a distance times that length.
        return (gap - 64 * _EPS * size) / np.linalg.norm(normals, axis=1) - self.radii

    def _box_distances(self, p: Stretches, q: Stretches) -> Array:
        """Distances of boxes that hold the shapes during each stretch; nothing where they meet or have no bounds."""
        a, b = p.boxes(), q.boxes()
        gaps = np.maximum(np.maximum(a.low - b.high, b.low - a.high), 0.0)
        distances = np.linalg.norm(gaps, axis=1) * (1.0 - 8 * _EPS)
        # How deep shapes overlap, boxes that meet do not say.
        return np.where(distances > 0.0, distances, -np.inf)

    def _search_closest(self) -> None:
        """Find the closest instants of the intervals that are too close, and of those that are proven least.

        The first are what margins are chosen by; the others make the distance in a report that of the motion, and not
        of the few instants that the proof needed.
        """
        found = set(np.flatnonzero(self.distance < self.needed).tolist())
        for i in found.union(np.argsort(self.proven, kind="stable")[:_SEARCHED].tolist()):
            low, high = 0.0, 1.0
            for _ in range(2):
                fractions = np.linspace(low, high, _SEARCH)
                self._look(np.full(_SEARCH, i), fractions)
                step = (high - low) / (_SEARCH - 1)
                low, high = max(self.instant[i] - step, 0.0), min(self.instant[i] + step, 1.0)


def _reach(p: Stretches, q: Stretches) -> Array:
    """Largest distance of the corners from one of them, at the ends of each stretch, shape ``(m,)``."""
    reach = np.zeros(len(p.start))
    for corners_p, corners_q in ((p.at_start[0], q.at_start[0]), (p.at_end[0], q.at_end[0])):
        for corners in (corners_p, corners_q):
            reach = np.maximum(reach, np.linalg.norm(corners - corners_q[:, :1, :], axis=2).max(axis=1))
    return reach


def _exact(p: Array, q: Array, p_rays: Array, q_rays: Array) -> tuple[Array, Array]:
    """Signed distances and normals of ``m`` pairs of point sets; NaN where a set is not finite."""
    distances, normals = np.full(len(p), np.nan), np.full((len(p), p.shape[2]), np.nan)
    finite = np.isfinite(p).all(axis=(1, 2)) & np.isfinite(q).all(axis=(1, 2))
    chosen = np.flatnonzero(finite)
    distances[chosen], normals[chosen] = distances_of_points(p[chosen], q[chosen], p_rays[chosen], q_rays[chosen])
    return distances, normals
