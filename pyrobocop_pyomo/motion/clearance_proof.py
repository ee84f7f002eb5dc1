"""`verify_clearance`: proves that bodies keep their distances at all times, or finds an instant at which they do not.

A subinterval of time is proven clear by one direction: along a fixed unit vector ``n`` the gap ``n . p_i - n . q_j``
of two corners is a function of time, which deviates from its chord by at most ``h^2 / 8`` times its second derivative.
Subintervals that are neither proven nor violated are halved. See the explanation of obstacle avoidance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import check_pose, distances_of_points, signed_distance
from pyrobocop_pyomo.numerics import Array, Indices

from .bodies import Body
from .motion import Motion
from .moving_shapes import MovingShape, PathBounds, moving_shapes
from .pose_templates import node_times
from .safety_report import BodyPairSafety, SafetyReport

_EPS = float(np.finfo(float).eps)
_TOLERANCE_PER_CLEARANCE = 0.01
# A normal and a ray that should be orthogonal differ by up to this in rounding. The error counts over the whole scene.
_RAY_TOLERANCE = 1e-9
# Instants per level of the search for the closest instant.
_SEARCH = 17
# So many intervals are searched although they are proven: the closest instant is nearly always in one of the three
# that are proven least.
_SEARCHED = 3


def verify_clearance(
    motion: Motion,
    bodies: Mapping[str, Body],
    clearances: Mapping[tuple[str, str], float],
    *,
    tolerance: float | None = None,
    depth: int = 24,
    max_subintervals: int = 20_000,
) -> SafetyReport:
    """Check the distances of body pairs over a whole motion, at the current values of the model.

    Parameters
    ----------
    motion : Motion
    bodies : mapping of name to Body
    clearances : dict of (str, str) to float
        The body pairs to check, and the distance that each has to keep.
    tolerance : float, optional
        Distances down to ``clearance - tolerance`` count as kept; 1 % of each clearance by default.
    depth : int
        How often a subinterval may be halved before the pair is undecided there.
    max_subintervals : int
        How many subintervals the proof of one pair may use.

    Returns
    -------
    SafetyReport
        Safe only where the distance is *proven*, up to rounding. There is one line per pair of convex parts. Intervals
        whose values do not describe the motion of a rigid body, because it jumps or is distorted by more than the
        tolerance, are undecided.

    Raises
    ------
    ObstacleError
        Naming the body whose pose cannot be followed between the nodes, or a body that does not exist.
    """
    for pair, clearance in clearances.items():
        _check_pair(bodies, pair, clearance, tolerance)
    if not motion.intervals:
        return _at_points(motion, bodies, clearances, tolerance)
    watched = {name: bodies[name] for name in dict.fromkeys(name for pair in clearances for name in pair)}
    shapes = moving_shapes(motion, watched)
    with np.errstate(all="ignore"):
        mismatches = {name: [shape.mismatch(motion) for shape in parts] for name, parts in shapes.items()}
    times = node_times(motion)
    ends = np.array([[times[nodes[0]], times[nodes[-1]]] for nodes in motion.intervals])
    results = []
    for (first, second), clearance in clearances.items():
        settings = ProofSettings(_tolerance(tolerance, clearance), depth, max_subintervals)
        results += [
            _prove_pair(p, q, clearance, ends, settings, p_mismatch + q_mismatch)
            for p, p_mismatch in zip(shapes[first], mismatches[first], strict=True)
            for q, q_mismatch in zip(shapes[second], mismatches[second], strict=True)
        ]
    return SafetyReport(tuple(results))


def _check_pair(bodies: Mapping[str, Body], pair: tuple[str, str], clearance: float, tolerance: float | None) -> None:
    missing = [name for name in pair if name not in bodies]
    if missing:
        raise ObstacleError(f"the body pair {pair} names '{missing[0]}'; the bodies are {', '.join(bodies)}.")
    sizes = [bodies[name].dimension for name in pair]
    if sizes[0] != sizes[1]:
        raise ObstacleError(f"the body pair {pair} is of a body in {sizes[0]} and one in {sizes[1]} dimensions.")
    if tolerance is not None and not 0.0 < tolerance < clearance:
        raise ObstacleError(
            f"tolerance = {tolerance!r}: expected a length between 0 and the clearance of {pair}, {clearance:g}. "
            "With a tolerance of 0, bodies that keep their clearance exactly could not be proven to."
        )


def _tolerance(tolerance: float | None, clearance: float) -> float:
    return _TOLERANCE_PER_CLEARANCE * clearance if tolerance is None else tolerance


def _at_points(
    motion: Motion, bodies: Mapping[str, Body], clearances: Mapping[tuple[str, str], float], tolerance: float | None
) -> SafetyReport:
    """Exact distances at points without an order, between which there is no motion."""
    poses: dict[tuple[str, Any], Any] = {}
    for name, body in bodies.items():
        for point in motion.points:
            pose = None if body.pose is None else motion.pose_at_node(body.pose, point, name=name)
            if pose is not None:
                check_pose(pose, name)
            poses[name, point] = pose
    results = []
    for (first, second), clearance in clearances.items():
        for p_name, p in bodies[first].named_parts(first):
            for q_name, q in bodies[second].named_parts(second):
                distances = np.array(
                    [signed_distance(p, q, poses[first, at], poses[second, at]).distance for at in motion.points]
                )
                worst = int(np.argmin(distances))
                results.append(
                    BodyPairSafety(
                        first=p_name,
                        second=q_name,
                        clearance=clearance,
                        tolerance=_tolerance(tolerance, clearance),
                        distance=float(distances[worst]),
                        proven=float(distances[worst]),
                        time=motion.points[worst],
                        interval=None,
                        interval_distance=distances,
                        interval_proven=distances,
                        undecided=(),
                        subintervals=len(distances),
                    )
                )
    return SafetyReport(tuple(results), between=False)


# ----------------------------------------------------------------------------------------------- proof of a single pair


@dataclass(frozen=True)
class ProofSettings:
    """Tolerance and effort of the proof for one pair; see `verify_clearance`."""

    tolerance: float
    depth: int
    max_subintervals: int


def _prove_pair(
    first: MovingShape, second: MovingShape, clearance: float, ends: Array, settings: ProofSettings, mismatch: Array
) -> BodyPairSafety:
    """Prove a clearance over all intervals.

    Parameters
    ----------
    first, second : MovingShape
    clearance : float
    ends : array, shape (intervals, 2)
        Times of the start and the end of each interval.
    settings : ProofSettings
    mismatch : array, shape (intervals,)
        Sum of the two shapes' `MovingShape.mismatch`. Intervals with more than the tolerance stay undecided.
    """
    with np.errstate(all="ignore"):  # what is not finite is never proven
        return _Proof(first, second, clearance, settings, len(ends)).run(ends, mismatch)


class _Proof:
    def __init__(
        self, first: MovingShape, second: MovingShape, clearance: float, settings: ProofSettings, intervals: int
    ) -> None:
        self.first, self.second, self.clearance, self.settings = first, second, clearance, settings
        self.needed = clearance - settings.tolerance
        self.radii = first.shape.radius + second.shape.radius
        self.distance = np.full(intervals, np.nan)  # NaN: not measured anywhere in the interval
        self.instant = np.full(intervals, 0.5)
        self.proven = np.full(intervals, np.inf)
        self.undecided: set[int] = set()
        self.subintervals = 0

    def run(self, ends: Array, mismatch: Array) -> BodyPairSafety:
        intervals = len(ends)
        interval = np.arange(intervals)
        start, end = np.zeros(intervals), np.ones(intervals)
        for level in range(self.settings.depth + 1):
            interval, start, end = self._level(interval, start, end, last=level == self.settings.depth)
            if len(interval) == 0:
                break
        self._search_closest()
        jumps = ~(mismatch <= self.settings.tolerance)
        self.proven[jumps] = -np.inf
        self.undecided.update(np.flatnonzero(jumps & ~(self.distance < self.needed)).tolist())
        worst = int(np.nanargmin(self.distance))
        interval_start, interval_end = ends[worst]
        return BodyPairSafety(
            first=self.first.name,
            second=self.second.name,
            clearance=self.clearance,
            tolerance=self.settings.tolerance,
            distance=float(self.distance[worst]),
            proven=float(self.proven.min()),
            time=float(interval_start + self.instant[worst] * (interval_end - interval_start)),
            interval=worst,
            interval_distance=self.distance,
            interval_proven=self.proven,
            undecided=tuple(sorted(self.undecided)),
            subintervals=self.subintervals,
        )

    def _level(self, interval: Indices, start: Array, end: Array, last: bool) -> tuple[Indices, Array, Array]:
        """Check subintervals; returns the halves of those that are not decided."""
        self.subintervals += len(interval)
        p = self.first.path_bounds(interval, start, end)
        q = self.second.path_bounds(interval, start, end)
        bound = self._box_distances(p, q)
        is_open = ~(bound >= self.clearance)
        chosen = np.flatnonzero(is_open)
        if len(chosen):
            if self.subintervals == len(interval):
                # The first level measures the ends of the intervals; later ends have been measured as middles.
                self._measure(interval[chosen], start[chosen])
                self._measure(interval[chosen], end[chosen])
            middle = 0.5 * (start[chosen] + end[chosen])
            distances, normals = self._measure(interval[chosen], middle)
            p, q = p.subset(chosen), q.subset(chosen)
            bound[chosen] = np.fmax(bound[chosen], self._plane_bounds(normals, p, q))
            # Where the normal of the middle has failed, the best one for both ends together may prove it.
            hard = np.flatnonzero(~(bound[chosen] >= self.needed) & (distances >= self.needed))
            if len(hard):
                swept = self._swept_normals(p.subset(hard), q.subset(hard))
                again = self._plane_bounds(swept, p.subset(hard), q.subset(hard))
                bound[chosen[hard]] = np.fmax(bound[chosen[hard]], again)
        bound = np.where(np.isnan(bound), -np.inf, bound)
        violated = self.distance[interval] < self.needed
        still_open = ~(bound >= self.needed) & ~violated
        gives_up = last or self.subintervals + 2 * int(still_open.sum()) > self.settings.max_subintervals
        if gives_up:
            self.undecided.update(interval[still_open].tolist())
        halved = np.zeros_like(still_open) if gives_up else still_open
        np.minimum.at(self.proven, interval[~halved], bound[~halved])
        middle = 0.5 * (start[halved] + end[halved])
        return (
            np.concatenate([interval[halved], interval[halved]]),
            np.concatenate([start[halved], middle]),
            np.concatenate([middle, end[halved]]),
        )

    def _measure(self, interval: Indices, fraction: Array) -> tuple[Array, Array]:
        """Exact distances and normals at instants; the closest instant of each interval is remembered."""
        p, p_rays = self.first.corners(interval, fraction)
        q, q_rays = self.second.corners(interval, fraction)
        distances, normals = _exact(p, q, p_rays, q_rays)
        distances = distances - self.radii
        for i, distance, at in zip(interval.tolist(), distances.tolist(), fraction.tolist(), strict=True):
            # False for NaN: an instant without values must not replace a measured distance.
            if distance < self.distance[i] or np.isnan(self.distance[i]):
                self.distance[i], self.instant[i] = distance, at
        return distances, normals

    def _swept_normals(self, p: PathBounds, q: PathBounds) -> Array:
        """Normals that separate best what both shapes cover at both ends, relative to the second shape's motion."""
        moved = (q.at_end[0] - q.at_start[0])[:, :1, :]
        _, normals = _exact(
            np.concatenate([p.at_start[0], p.at_end[0] - moved], axis=1),
            np.concatenate([q.at_start[0], q.at_end[0] - moved], axis=1),
            np.concatenate([p.at_start[1], p.at_end[1]], axis=1),
            np.concatenate([q.at_start[1], q.at_end[1]], axis=1),
        )
        return normals

    def _plane_bounds(self, normals: Array, p: PathBounds, q: PathBounds) -> Array:
        """Lower bound that a fixed direction proves for the signed distance on each subinterval, shape ``(m,)``."""
        ends = []
        for corners_p, corners_q in ((p.at_start[0], q.at_start[0]), (p.at_end[0], q.at_end[0])):
            # Relative to one of the corners: scenes far from the origin lose no digits.
            origin = corners_q[:, :1, :]
            along_p = np.einsum("mr,mir->mi", normals, corners_p - origin)
            along_q = np.einsum("mr,mjr->mj", normals, corners_q - origin)
            ends.append(along_p[:, :, None] - along_q[:, None, :])
        p_curvature, q_curvature = p.curvature_bounds(normals), q.curvature_bounds(normals)
        curvature = np.maximum(p_curvature.high[:, :, None] - q_curvature.low[:, None, :], 0.0)
        chord = np.minimum(ends[0], ends[1]) - p.deviation_factor[:, None, None] * curvature
        # Where second derivatives are unbounded, values may still be bounded: a root that starts at zero, for example.
        values = p.value_bounds(normals).low[:, :, None] - q.value_bounds(normals).high[:, None, :]
        gap = np.fmax(chord, values).min(axis=(1, 2))
        # A normal that is not quite orthogonal to a ray loses the angle times the size of the scene.
        leaning = np.maximum(-p.ray_bounds(normals).low.min(axis=1, initial=0.0), 0.0)
        leaning = np.maximum(leaning, q.ray_bounds(normals).high.max(axis=1, initial=0.0))
        gap = np.where(leaning <= _RAY_TOLERANCE, gap - 4.0 * leaning * _reach(p, q), -np.inf)
        size = np.maximum(np.abs(ends[0]), np.abs(ends[1])).max(axis=(1, 2))
        # A gap along a vector of any length is a distance times that length.
        return (gap - 64 * _EPS * size) / np.linalg.norm(normals, axis=1) - self.radii

    def _box_distances(self, p: PathBounds, q: PathBounds) -> Array:
        """Distances of the boxes around the shapes on each subinterval; ``-inf`` where they meet or are unbounded."""
        a, b = p.boxes(), q.boxes()
        gaps = np.maximum(np.maximum(a.low - b.high, b.low - a.high), 0.0)
        distances = np.linalg.norm(gaps, axis=1) * (1.0 - 8 * _EPS)
        # Boxes that meet say nothing about the depth of an overlap.
        return np.where(distances > 0.0, distances, -np.inf)

    def _search_closest(self) -> None:
        """Search the closest instants of the intervals that are too close, and of those that are proven least.

        Margins are chosen by the former. The latter make the reported distance one of the motion, and not only of the
        few instants that the proof needed.
        """
        searched = set(np.flatnonzero(self.distance < self.needed).tolist())
        for i in searched.union(np.argsort(self.proven, kind="stable")[:_SEARCHED].tolist()):
            low, high = 0.0, 1.0
            for _ in range(2):
                fractions = np.linspace(low, high, _SEARCH)
                self._measure(np.full(_SEARCH, i), fractions)
                step = (high - low) / (_SEARCH - 1)
                low, high = max(self.instant[i] - step, 0.0), min(self.instant[i] + step, 1.0)


def _reach(p: PathBounds, q: PathBounds) -> Array:
    """Largest distance of the corners from one of them, at the ends of each subinterval, shape ``(m,)``."""
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
