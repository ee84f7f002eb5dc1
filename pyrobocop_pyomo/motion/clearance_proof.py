"""`verify_clearance`: proves that bodies keep their distances at all times, or finds an instant at which they do not.

A subinterval of time is proven clear by one direction: along a fixed unit vector ``n`` the gap ``n . p_i - n . q_j``
of two corners is a function of time, which deviates from its chord by at most ``h^2 / 8`` times its second derivative.
Subintervals that are neither proven nor violated are halved. See the explanation of obstacle avoidance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import (
    PathBounds,
    PointSets,
    distances_of_points,
    heights,
)
from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.numerics.interval_arithmetic import Interval
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

from .bodies import Body
from .equations_motion import EquationsMotion, replayed_motion
from .motion import Motion
from .moving_shapes import (
    SAMPLES,
    MovingShape,
    RequiredBounds,
    RequiredClearance,
    moving_shapes,
    required_clearance,
)
from .safety_report import BodyPairSafety, SafetyReport

_EPS = float(np.finfo(float).eps)
_TOLERANCE_PER_CLEARANCE = 0.01
# So many intervals of a pair are searched although they are proven: the closest instant is nearly always in one of the
# three that are proven least. Of the pairs that boxes settle so many are searched as well.
_SEARCHED = 3


def verify_clearance(
    motion: Motion,
    bodies: Mapping[str, Body],
    clearances: Mapping[tuple[str, str], Any],
    *,
    tolerance: float | None = None,
    depth: int = 24,
    max_subintervals: int = 20_000,
    equations: bool = True,
) -> SafetyReport:
    """Check the distances of body pairs over a whole motion, at the current values of the model.

    Parameters
    ----------
    motion : Motion
    bodies : mapping of name to Body
    clearances : dict of (str, str) to number, expression or callable
        The body pairs to check, and the distance that each has to keep: the same at all times, or
        ``rule(block, t)``, a formula like a pose rule.
    tolerance : float, optional
        Distances down to ``clearance - tolerance`` count as kept; by default 1 % of each clearance, of its least value
        at the nodes where it changes.
    depth : int
        How often a subinterval may be halved before the pair is undecided there.
    max_subintervals : int
        How many subintervals the proof of one pair may use.
    equations : bool
        Whether the motion that the equations make of the plan's controls is proven as well.

    Returns
    -------
    SafetyReport
        Clear only where the distance is *proven*, up to rounding, for the plan; safe where it is proven as well for the
        motion that the equations of the model make of its controls, or where there are none. There is one line per pair
        of convex parts. Intervals whose values do not describe the motion of a rigid body, because it jumps or is
        distorted by more than the tolerance, are undecided.

    Raises
    ------
    ObstacleError
        Naming the body whose pose cannot be followed between the nodes, or a body that does not exist.
    """
    for pair in clearances:
        missing = [name for name in pair if name not in bodies]
        if missing:
            raise ObstacleError(f"the body pair {pair} names '{missing[0]}'; the bodies are {', '.join(bodies)}.")
        first, second = (bodies[name].dimension for name in pair)
        if first != second:
            raise ObstacleError(f"the body pair {pair} is of a body in {first} and one in {second} dimensions.")
    watched = {name: bodies[name] for name in dict.fromkeys(name for pair in clearances for name in pair)}
    shapes = moving_shapes(motion, watched)
    required = {pair: required_clearance(motion, asked, pair) for pair, asked in clearances.items()}
    parts = [shape for shapes_of_body in shapes.values() for shape in shapes_of_body]
    replayed = replayed_motion(motion, [*parts, *required.values()], equations=equations)
    proofs = [
        _Proof(p, q, clearance, _allowed(pair, clearance.least, tolerance), depth, max_subintervals, replayed)
        for pair, clearance in required.items()
        for p in shapes[pair[0]]
        for q in shapes[pair[1]]
    ]
    ends = motion.interval_ends
    with np.errstate(all="ignore"):  # what is not finite is never proven
        results = _proven(proofs, ends)
    return SafetyReport(
        tuple(results),
        motion=motion.description,
        motion_is_assumed=motion.is_assumed,
        equations=replayed.statement,
    )


def _allowed(pair: tuple[str, str], clearance: float, tolerance: float | None) -> float:
    """By how much the clearance of a pair may be missed."""
    if tolerance is not None and not 0.0 < tolerance < clearance:
        raise ObstacleError(
            f"tolerance = {tolerance!r}: expected a length between 0 and the clearance of {pair}, {clearance:g}. "
            "With a tolerance of 0, bodies that keep their clearance exactly could not be proven to."
        )
    return _TOLERANCE_PER_CLEARANCE * clearance if tolerance is None else tolerance


# ----------------------------------------------------------------------------------------------- proof of a single pair


def _proven(proofs: Sequence[_Proof], ends: Array) -> list[BodyPairSafety]:
    """Prove the clearances of all pairs over all intervals with the times `ends`, shape (intervals, 2)."""
    if not proofs:
        return []
    bounds = _bounds_by_boxes(proofs, len(ends))
    far = np.flatnonzero((bounds >= np.maximum([proof.needed for proof in proofs], 0.0)).all(axis=1))
    # The nearest of the far pairs are searched like all others: the smallest distance of a report is one of theirs.
    nearest = np.argsort(bounds[far].min(axis=1), kind="stable")
    unsearched = set(far[nearest[_SEARCHED:]].tolist())
    results = []
    for k, proof in enumerate(proofs):
        proof.prove(bounds[k], search=k not in unsearched)
        results.append(proof.result(ends))
    return results


def _bounds_by_boxes(proofs: Sequence[_Proof], intervals: int) -> Array:
    """Lower bounds of the excess of all pairs by the boxes around whole intervals, shape (pairs, intervals).

    The boxes are made once per shape, and compared for all pairs and intervals in one operation. For pairs that are far
    apart in all intervals that is the whole proof.
    """
    whole = np.arange(intervals), np.zeros(intervals), np.ones(intervals)
    shapes = {id(shape): shape for proof in proofs for shape in (proof.first, proof.second)}
    clearances = {id(proof.clearance): proof.clearance for proof in proofs}
    boxes = {key: shape.path_bounds(*whole).boxes() for key, shape in shapes.items()}
    highest = {key: clearance.bounds(*whole).highest for key, clearance in clearances.items()}
    bounds = np.stack(
        [
            box_distances(boxes[id(proof.first)], boxes[id(proof.second)]) - highest[id(proof.clearance)]
            for proof in proofs
        ]
    )
    return np.where(np.isnan(bounds), -np.inf, bounds)


def box_distances(a: Interval, b: Interval) -> Array:
    """Lower bounds of the distances of boxes (..., d); ``-inf`` where they meet or are unbounded."""
    gaps = np.maximum(np.maximum(a.low - b.high, b.low - a.high), 0.0)
    distances = np.linalg.norm(gaps, axis=-1) * (1.0 - 8 * _EPS)
    # Boxes that meet say nothing about the depth of an overlap.
    return np.where(distances > 0.0, distances, -np.inf)


@dataclass(eq=False)
class _Proof:
    """The proof of one pair, in terms of the *excess*: signed distance less the clearance required at that time.

    Attributes
    ----------
    tolerance, depth, max_subintervals
        As of `verify_clearance`.
    replayed : EquationsMotion
    """

    first: MovingShape
    second: MovingShape
    clearance: RequiredClearance
    tolerance: float
    depth: int
    max_subintervals: int
    replayed: EquationsMotion

    def __post_init__(self) -> None:
        parts = (self.first, self.second, self.clearance)
        # How far the equations lead away from the plan, and why that is not known, where it is not.
        self.deviation = np.sum([self.replayed.of(part.name) for part in parts], axis=0)
        is_read = any(part.name in self.replayed.deviation for part in parts)
        self.not_replayed = self.replayed.why_unknown if is_read else ""
        # By how much the formulas are wrong at the nodes.
        self.mismatch = np.zeros(self.replayed.intervals) + sum(part.mismatch for part in parts)
        # More where the equations lead away from the plan.
        self.needed = np.where(np.isfinite(self.deviation), self.deviation, 0.0) - self.tolerance
        self.radii = self.first.shape.radius + self.second.shape.radius
        intervals = len(self.deviation)
        self.excess = np.full(intervals, np.nan)  # NaN: not measured anywhere in the interval
        self.instant = np.full(intervals, 0.5)
        self.proven = np.full(intervals, np.inf)  # a lower bound of the excess
        self.subintervals = 0

    def prove(self, bounds: Array, *, search: bool) -> None:
        """Prove what boxes do not prove, interval by interval.

        Parameters
        ----------
        bounds : array, shape (intervals,)
            Lower bounds of the excess that boxes around whole intervals prove.
        search : bool
            Whether the closest instants are searched; else that in which the boxes are nearest is measured.
        """
        settled = bounds >= np.maximum(self.needed, 0.0)
        self.proven[settled] = bounds[settled]
        self.subintervals = int(settled.sum())
        interval = np.flatnonzero(~settled)
        start, end = np.zeros(len(interval)), np.ones(len(interval))
        for level in range(self.depth + 1):
            if len(interval) == 0:
                break
            interval, start, end = self._level(interval, start, end, level, bounds if level == 0 else None)
        if search:
            self._search_closest()
        else:
            self._measure(np.full(3, bounds.argmin()), np.array([0.0, 0.5, 1.0]))

    def result(self, ends: Array) -> BodyPairSafety:
        """The findings, with the times of all intervals."""
        # Intervals in which more is wrong with the formulas than the tolerance stay undecided.
        self.proven[~(self.mismatch <= self.tolerance)] = -np.inf
        required = self.clearance.values(np.arange(len(ends)), self.instant)
        return BodyPairSafety(
            first=self.first.name,
            second=self.second.name,
            tolerance=self.tolerance,
            subintervals=self.subintervals,
            interval_distance=required + self.excess,
            interval_proven=required + self.proven,
            interval_clearance=required,
            interval_deviation=self.deviation,
            interval_times=ends[:, 0] + self.instant * (ends[:, 1] - ends[:, 0]),
            interval_ends=ends,
            not_replayed=self.not_replayed,
        )

    def _level(
        self, interval: Indices, start: Array, end: Array, level: int, boxes: Array | None
    ) -> tuple[Indices, Array, Array]:
        """Check subintervals; returns the halves of those that are not decided. `boxes` are bounds that are known."""
        self.subintervals += len(interval)
        last = level == self.depth
        p = self.first.path_bounds(interval, start, end)
        q = self.second.path_bounds(interval, start, end)
        required = self.clearance.bounds(interval, start, end)
        bound = box_distances(p.boxes(), q.boxes()) - required.highest if boxes is None else boxes[interval]
        is_open = ~(bound >= np.maximum(self.needed[interval], 0.0))
        chosen = np.flatnonzero(is_open)
        if len(chosen):
            if level == 0:
                # The first level measures the ends of the intervals; later ends have been measured as middles.
                self._measure(interval[chosen], start[chosen])
                self._measure(interval[chosen], end[chosen])
            middle = 0.5 * (start[chosen] + end[chosen])
            excesses, normals = self._measure(interval[chosen], middle)
            p, q, required = p.subset(chosen), q.subset(chosen), required.subset(chosen)
            bound[chosen] = np.fmax(bound[chosen], self._plane_bounds(normals, p, q, required))
            # Where the normal of the middle has failed, the best one for both ends together may prove it.
            needed = self.needed[interval[chosen]]
            hard = np.flatnonzero(~(bound[chosen] >= needed) & (excesses >= needed))
            if len(hard):
                swept = self._swept_normals(p.subset(hard), q.subset(hard))
                again = self._plane_bounds(swept, p.subset(hard), q.subset(hard), required.subset(hard))
                bound[chosen[hard]] = np.fmax(bound[chosen[hard]], again)
        bound = np.where(np.isnan(bound), -np.inf, bound)
        violated = self.excess[interval] < self.needed[interval]
        still_open = ~(bound >= self.needed[interval]) & ~violated
        gives_up = last or self.subintervals + 2 * int(still_open.sum()) > self.max_subintervals
        halved = np.zeros_like(still_open) if gives_up else still_open
        np.minimum.at(self.proven, interval[~halved], bound[~halved])
        interval, start, end = interval[halved], start[halved], end[halved]
        middle = 0.5 * (start + end)
        return np.tile(interval, 2), np.concatenate([start, middle]), np.concatenate([middle, end])

    def _measure(self, interval: Indices, fraction: Array) -> tuple[Array, Array]:
        """Excesses and normals at instants; the instant of each interval with the least excess is remembered."""
        distances, normals = _exact(self.first.places(interval, fraction), self.second.places(interval, fraction))
        excesses = distances - self.radii - self.clearance.values(interval, fraction)
        # The least of each interval; NaN is sorted last.
        order = np.lexsort((excesses, interval))
        measured, first = np.unique(interval[order], return_index=True)
        least = order[first]
        # False for NaN: an instant without values must not replace a measured distance.
        closer = (excesses[least] < self.excess[measured]) | np.isnan(self.excess[measured])
        self.excess[measured[closer]] = excesses[least[closer]]
        self.instant[measured[closer]] = fraction[least[closer]]
        return excesses, normals

    def _swept_normals(self, p: PathBounds, q: PathBounds) -> Array:
        """Normals that separate best what both shapes cover at both ends, relative to the second shape's motion."""
        back = (q.at_start.corners - q.at_end.corners)[:, 0]
        _, normals = _exact(*(of.at_start.joined(of.at_end.moved(back)) for of in (p, q)))
        return normals

    def _plane_bounds(self, normals: Array, p: PathBounds, q: PathBounds, required: RequiredBounds) -> Array:
        """Lower bound that a fixed direction proves for the excess on each subinterval, shape ``(m,)``."""
        # A gap along a vector of any length is a distance times that length.
        length = np.linalg.norm(normals, axis=1)
        ends = []
        for of_p, of_q in ((p.at_start, q.at_start), (p.at_end, q.at_end)):
            # Relative to one of the corners: scenes far from the origin lose no digits.
            origin = of_q.corners[:, 0]
            lowest, _ = heights(normals, of_p.moved(-origin))
            _, highest = heights(normals, of_q.moved(-origin))
            ends.append(lowest[:, :, None] - highest[:, None, :])
        p_curvature, q_curvature = p.curvature_bounds(normals), q.curvature_bounds(normals)
        rising = (length * required.lowest_curvature)[:, None, None]
        curvature = np.maximum(p_curvature.high[:, :, None] - q_curvature.low[:, None, :] - rising, 0.0)
        offsets = [(length * at)[:, None, None] for at in (required.at_start, required.at_end, required.highest)]
        chord = np.minimum(ends[0] - offsets[0], ends[1] - offsets[1]) - p.deviation_factor[:, None, None] * curvature
        # Where second derivatives are unbounded, values may still be bounded: a root that starts at zero, for example.
        values = p.value_bounds(normals).low[:, :, None] - q.value_bounds(normals).high[:, None, :]
        gap = np.fmax(chord, values - offsets[2]).min(axis=(1, 2))
        # A normal that is not quite orthogonal to a ray loses the angle times the size of the scene.
        leaning = np.maximum(-p.ray_bounds(normals).low.min(axis=1, initial=0.0), 0.0)
        leaning = np.maximum(leaning, q.ray_bounds(normals).high.max(axis=1, initial=0.0))
        gap = np.where(leaning <= NEGLIGIBLE, gap - 4.0 * leaning * _reach(p, q), -np.inf)
        size = np.maximum(np.abs(ends[0]), np.abs(ends[1])).max(axis=(1, 2)) + np.abs(required.highest)
        return (gap - 64 * _EPS * size) / length - self.radii

    def _search_closest(self) -> None:
        """Search the closest instants of the intervals that are too close, and of those that are proven least.

        Margins are chosen by the former. The latter make the reported distance one of the motion, and not only of the
        few instants that the proof needed.
        """
        least_proven = np.argsort(self.proven, kind="stable")[:_SEARCHED]
        searched = np.union1d(np.flatnonzero(self.excess < self.needed), least_proven)
        low, high = np.zeros(len(searched)), np.ones(len(searched))
        for _ in range(2):
            fractions = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, SAMPLES)
            self._measure(np.repeat(searched, SAMPLES), fractions.ravel())
            step = (high - low) / (SAMPLES - 1)
            low = np.maximum(self.instant[searched] - step, 0.0)
            high = np.minimum(self.instant[searched] + step, 1.0)


def _reach(p: PathBounds, q: PathBounds) -> Array:
    """Largest distance of the corners from one of them, at the ends of each subinterval, shape ``(m,)``."""
    reach = np.zeros(len(p.start))
    for of_p, of_q in ((p.at_start, q.at_start), (p.at_end, q.at_end)):
        for of in (of_p, of_q):
            reach = np.maximum(reach, np.linalg.norm(of.corners - of_q.corners[:, :1, :], axis=2).max(axis=1))
    return reach


def _exact(p: PointSets, q: PointSets) -> tuple[Array, Array]:
    """Signed distances and normals of ``m`` pairs of point sets; NaN where a set is not finite."""
    distances, normals = np.full(len(p.corners), np.nan), np.full(p.corners[:, 0].shape, np.nan)
    finite = np.isfinite(p.corners).all(axis=(1, 2)) & np.isfinite(q.corners).all(axis=(1, 2))
    chosen = np.flatnonzero(finite)
    distances[chosen], normals[chosen] = distances_of_points(p.subset(chosen), q.subset(chosen))
    return distances, normals
