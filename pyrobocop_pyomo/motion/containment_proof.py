"""`verify_inside`: proves that a body is inside one of several convex regions at all times.

Along the outward normal of a side a corner's coordinate is a function of time, which exceeds the higher of its ends by
at most ``h^2 / 8`` times its second derivative. A subinterval is proven where this keeps all corners inside all sides
of one region; subintervals that are neither proven nor violated are halved.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.numerics import Array, Indices

from .bodies import Body
from .equations_motion import EquationsMotion, equations_motion
from .motion import Motion
from .moving_shapes import MovingShape, PathBounds, halves, moving_shapes
from .pose_templates import node_times
from .safety_report import BodyPairSafety, SafetyReport

_EPS = float(np.finfo(float).eps)
_DEPTH = 20
_MAX_SUBINTERVALS = 20_000
# Instants at which intervals that are not proven are searched.
_SEARCH = 33


def verify_inside(
    motion: Motion,
    body: Body,
    regions: Sequence[Polytope],
    clearance: float,
    tolerance: float,
    *,
    equations: bool = True,
) -> SafetyReport:
    """Check that each convex part of a body is inside one of the regions at all times, at the current values.

    Parameters
    ----------
    motion : Motion
        With intervals.
    body : Body
    regions : sequence of Polytope
        With half-spaces, and without radius.
    clearance, tolerance : float
        The distance to be kept from the sides, >= 0, and how much of it may be missing.
    equations : bool
        Whether the motion that the equations make of the plan's controls is proven as well.

    Returns
    -------
    SafetyReport
        One line per part. Its distance is the room left in the region with the most room: the distance of the part to
        the nearest side, negative outside. A part that is inside the union, but not inside any one region, counts as
        outside.

    Raises
    ------
    ObstacleError
        When the pose of the body cannot be followed between the nodes.
    """
    shapes = moving_shapes(motion, {"body": body})
    led = equations_motion(motion, shapes) if equations else EquationsMotion()
    times = node_times(motion)
    ends = np.array([[times[nodes[0]], times[nodes[-1]]] for nodes in motion.intervals])
    results = []
    for shape in shapes["body"]:
        deviation = led.of(shape.name, len(ends))
        with np.errstate(all="ignore"):  # what is not finite is never proven
            proof = _InsideProof(shape, regions, clearance, tolerance, deviation)
            results.append(proof.run(ends, shape.mismatch(motion)))
    return SafetyReport(
        tuple(results),
        motion=motion.description({"body": body}),
        motion_is_assumed=motion.is_assumed({"body": body}),
        equations=led.statement,
        equations_unknown=bool(led.why_unknown),
    )


def room_in_regions(corners: Array, radius: float, regions: Sequence[Polytope]) -> Array:
    """Distance of corners (m, v, d) to the nearest side of each region, negative outside, shape ``(m, regions)``."""
    rooms = []
    for region in regions:
        outwards, offsets = region.halfspaces
        rooms.append((offsets - np.einsum("mid,sd->mis", corners, outwards)).min(axis=(1, 2)) - radius)
    return np.stack(rooms, axis=1)


class _InsideProof:
    def __init__(
        self, shape: MovingShape, regions: Sequence[Polytope], clearance: float, tolerance: float, deviation: Array
    ) -> None:
        self.shape, self.regions = shape, regions
        self.clearance, self.tolerance, self.deviation = clearance, tolerance, deviation
        self.needed = clearance + np.where(np.isfinite(deviation), deviation, 0.0) - tolerance
        self.room = np.full(len(deviation), np.inf)
        self.instant = np.full(len(deviation), 0.5)
        self.proven = np.full(len(deviation), np.inf)
        self.undecided: set[int] = set()
        self.subintervals = 0

    def run(self, ends: Array, mismatch: Array) -> BodyPairSafety:
        count = len(ends)
        interval, start, end = np.arange(count), np.zeros(count), np.ones(count)
        self._measure(interval, start)
        self._measure(interval, end)
        for level in range(_DEPTH + 1):
            interval, start, end = self._level(interval, start, end, last=level == _DEPTH)
            if len(interval) == 0:
                break
        unproven = np.flatnonzero(~(self.proven >= self.needed))
        if len(unproven):
            self._measure(np.repeat(unproven, _SEARCH), np.tile(np.linspace(0.0, 1.0, _SEARCH), len(unproven)))
        jumps = ~(mismatch <= self.tolerance)
        self.proven[jumps] = -np.inf
        self.undecided.update(np.flatnonzero(jumps & ~(self.room < self.needed)).tolist())
        worst = int(np.argmin(self.room))
        return BodyPairSafety(
            first=self.shape.name,
            second=f"outside of {len(self.regions)} regions",
            clearance=self.clearance,
            tolerance=self.tolerance,
            distance=float(self.room[worst]),
            proven=float(self.proven.min()),
            time=float(ends[worst, 0] + self.instant[worst] * (ends[worst, 1] - ends[worst, 0])),
            interval=worst,
            interval_distance=self.room,
            interval_proven=self.proven,
            undecided=tuple(sorted(self.undecided)),
            subintervals=self.subintervals,
            interval_clearance=np.full(count, self.clearance),
            interval_deviation=self.deviation,
        )

    def _level(self, interval: Indices, start: Array, end: Array, last: bool) -> tuple[Indices, Array, Array]:
        """Check subintervals; returns the halves of those that are not decided."""
        self.subintervals += len(interval)
        self._measure(interval, 0.5 * (start + end))
        path = self.shape.path_bounds(interval, start, end)
        bound = np.max([_least_room(path, region, self.shape.shape.radius) for region in self.regions], axis=0)
        bound = np.where(np.isnan(bound), -np.inf, bound)
        still_open = ~(bound >= self.needed[interval]) & ~(self.room[interval] < self.needed[interval])
        gives_up = last or self.subintervals + 2 * int(still_open.sum()) > _MAX_SUBINTERVALS
        if gives_up:
            self.undecided.update(interval[still_open].tolist())
        halved = np.zeros_like(still_open) if gives_up else still_open
        np.minimum.at(self.proven, interval[~halved], bound[~halved])
        return halves(interval[halved], start[halved], end[halved])

    def _measure(self, interval: Indices, fraction: Array) -> None:
        """Measure the room at instants; the least of each interval is remembered."""
        corners, _ = self.shape.corners(interval, fraction)
        rooms = room_in_regions(corners, self.shape.shape.radius, self.regions).max(axis=1)
        for i, room, at in zip(interval.tolist(), rooms.tolist(), fraction.tolist(), strict=True):
            if room < self.room[i]:  # false for NaN
                self.room[i], self.instant[i] = room, at


def _least_room(path: PathBounds, region: Polytope, radius: float) -> Array:
    """Lower bound of the distance to the nearest side of a region on each subinterval, shape ``(m,)``."""
    least = np.full(len(path.start), np.inf)
    for outwards, offset in zip(*region.halfspaces, strict=True):
        normals = np.broadcast_to(outwards, (len(path.start), len(outwards)))
        ends = [corners @ outwards for corners in (path.at_start[0], path.at_end[0])]
        bulge = path.deviation_factor[:, None] * np.maximum(-path.curvature_bounds(normals).low, 0.0)
        highest = np.fmin(np.maximum(ends[0], ends[1]) + bulge, path.value_bounds(normals).high)
        rounding = 64 * _EPS * (np.maximum(np.abs(ends[0]), np.abs(ends[1])).max(axis=1) + abs(offset))
        least = np.minimum(least, offset - highest.max(axis=1) - rounding - radius)
    return least
