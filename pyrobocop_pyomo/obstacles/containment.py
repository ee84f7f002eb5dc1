"""`Containment`: a body that stays inside a convex region, or inside the union of several, as a Pyomo block."""

from __future__ import annotations

import logging
import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.component import ModelComponentFactory
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.param import Param
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.set import Set
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.modeling.blocks import Rule
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.motion.clearance_proof import verify_clearance
from pyrobocop_pyomo.motion.containment_proof import room_in_regions, verify_inside
from pyrobocop_pyomo.motion.safety_report import BodyPairSafety, SafetyReport

from .block_arguments import MotionBlock, MotionBlockData, set_of_points, sort_arguments
from .clocks import check_rules
from .formulations.rows import dot
from .region_choice import choose_regions, shifted_changes
from .snapshot import variables_of

LOGGER = logging.getLogger(__name__)

# Room up to which a side is touched, relative to the size of the body.
_ACTIVE = 1e-4


@dataclass
class ContainmentRecord:
    """The facts behind a `Containment`."""

    body: Body
    regions: tuple[Polytope, ...]
    points: Any
    times: tuple[Any, ...]
    poses: dict[Any, Pose]
    cells: tuple[tuple[int, ...], ...] = ()  # positions in `times`: those of each interval, or single ones
    choice: list[int] = field(default_factory=list)  # the region of each cell


class ContainmentData(MotionBlockData):
    """One containment; see `Containment` for how to make one.

    Attributes
    ----------
    inside : Constraint
        ``inside[t, corner, side]``: every corner inside every side of the region. In a union the sides of all regions
        are numbered one after the other; a time between two regions has rows for both.
    clearance : Param
        Distance kept from the sides; mutable.
    margin : Param
        By time: added to the clearance, for the motion between the times.
    """

    _kind = "containment"

    @property
    def record(self) -> ContainmentRecord:
        """Body, region and poses behind this block."""
        return self._record_if_built()

    def build(self, points: Any, **options: Any) -> None:
        """Build the block; for rules of indexed blocks, with the arguments of the class.

        Raises
        ------
        ObstacleError
            When the arguments contradict themselves; nothing is then left on the block.
        """
        self._build_once(points, **options)

    def _build(
        self,
        points: Any,
        *,
        body: Any = None,
        pose: Any = None,
        region: Any = None,
        clearance: float = 0.0,
        between_points: Any = None,
    ) -> None:
        points = set_of_points(self, points)
        moving = _checked_body(self._what, body, pose, between_points)
        regions = _checked_regions(self._what, region, moving)
        if not (isinstance(clearance, (int, float)) and math.isfinite(clearance) and clearance >= 0):
            raise ObstacleError(f"{self._what}: the clearance is {clearance!r}; it must be a length >= 0.")
        self._record = ContainmentRecord(moving, regions, points, (), {})
        self.clearance = Param(initialize=float(clearance), mutable=True, doc="distance kept from the sides")
        self.times = Set(ordered=True, doc="times at which corners have rows")
        self.margin = Param(self.times, mutable=True, doc="added to the clearance")
        self.inside = Constraint(AnyIndex, doc="corners inside the sides of the region")
        self.motion.check_formula(moving, "body")
        check_rules(self._what, self.motion, {"body": moving})
        self._contain()

    def _contain(self) -> None:
        """Add the rows of all times."""
        record, motion = self.record, self.motion
        moving = record.body
        times = tuple(dict.fromkeys(t for nodes in motion.intervals for t in nodes)) or motion.points
        poses = {time: motion.pose_at_node(moving.pose, time) for time in times} if moving.pose is not None else {}
        position = {time: k for k, time in enumerate(times)}
        cells = tuple(tuple(position[time] for time in nodes) for nodes in motion.intervals)
        record.times, record.poses, record.choice = times, poses, []
        record.cells = cells or tuple((k,) for k in range(len(times)))
        self.times.update(times)
        for time in times:
            self.margin[time] = 0.0
        self.choose([0] * len(record.cells))
        if len(record.regions) > 1 and all(
            v.value is not None for placed in poses.values() for v in variables_of(placed)
        ):
            self.initialize()

    # ---------------------------------------------------------------- which interval is in which region

    def initialize(self) -> None:
        """Choose the region of each interval from the current poses; nothing to choose where there is one region.

        The choice violates the regions least along time, among those whose changes the body fits through.
        """
        record = self.record
        if len(record.regions) == 1:
            return
        rooms, extents = self._rooms_and_extents()
        clearance, size = float(value(self.clearance)), _size(record.body)
        resting = [Pose(Pose.identity(pose.dimension).rotation, pose.translation) for pose in self._poses()]
        fixed = np.array([all(variable.fixed for variable in variables_of(pose)) for pose in resting])
        choice, misfit = choose_regions(record.cells, rooms, extents, record.regions, clearance, size, fixed)
        if misfit > 1e-9 * size:
            LOGGER.warning(
                "%s: at the initial guess no chain of overlapping regions is wide enough for the body: an overlap is "
                "too narrow by %.3g at the angles of the guess. Enlarge it, or take more elements.",
                self._what,
                misfit,
            )
        outside = -float(rooms.max(axis=1).min())
        if outside > 0.0:
            worst = record.times[int(rooms.max(axis=1).argmin())]
            LOGGER.info("%s: the initial guess is %.3g outside all regions at %s.", self._what, outside, worst)
        self.choose(choice)

    def choose(self, regions: Sequence[int]) -> None:
        """Put each interval into a region.

        Parameters
        ----------
        regions : sequence of int
            Position of a region, for each interval; for each point where there are no intervals.

        Raises
        ------
        ObstacleError
            When there are not as many as intervals, or there is no such region.
        """
        record = self.record
        if len(regions) != len(record.cells) or not all(0 <= k < len(record.regions) for k in regions):
            raise ObstacleError(
                f"{self._what}: choose() got {list(regions)!r}; expected {len(record.cells)} numbers from 0 to "
                f"{len(record.regions) - 1}, one per interval."
            )
        if list(regions) == record.choice:
            return
        record.choice = list(regions)
        wanted = dict.fromkeys((k, chosen) for cell, chosen in zip(record.cells, regions, strict=True) for k in cell)
        first_side = np.cumsum([0] + [len(region.halfspaces[1]) for region in record.regions]).tolist()
        corners = [(corner, part.radius) for part in record.body.parts for corner in part.vertices.tolist()]
        with PauseGC():
            self.inside.clear()
            for k, chosen in wanted:
                time = record.times[k]
                placed, room = record.poses[time], self.clearance + self.margin[time]
                sides, offsets = record.regions[chosen].halfspaces
                for number, (corner, radius) in enumerate(corners):
                    point = placed.apply(corner)
                    for side, (outwards, offset) in enumerate(zip(sides.tolist(), offsets.tolist(), strict=True)):
                        place = (time, number, first_side[chosen] + side)
                        self.inside.add(place, (None, dot(outwards, point) + room, offset - radius))

    def revise(self) -> int:
        """Move the changes of region where the motion of the current values presses against a side of one of the two.

        Returns
        -------
        int
            How many intervals are in another region now.
        """
        record = self.record
        if len(record.regions) == 1:
            return 0
        rooms, _ = self._rooms_and_extents()
        places = np.array([record.poses[time].numbers()[1] for time in record.times])
        active = float(value(self.clearance)) + _ACTIVE * _size(record.body)
        changed = shifted_changes(record.cells, record.choice, rooms, places, active)
        count = sum(a != b for a, b in zip(changed, record.choice, strict=True))
        self.choose(changed)
        return count

    def _poses(self) -> list[Pose]:
        return [self.record.poses[time] for time in self.record.times]

    def rooms_at(self, time: Hashable) -> list[float]:
        """Distance of the body to the nearest side of each region at a time with a pose; negative outside."""
        return self._rooms_and_extents((time,))[0][0].tolist()

    def _rooms_and_extents(self, times: Sequence[Any] | None = None) -> tuple[np.ndarray, list[np.ndarray]]:
        """By time: the room in each region, and by region how far the body reaches along each outward normal."""
        record = self.record
        rotations, translations = zip(
            *(record.poses[time].numbers() for time in record.times if times is None or time in times), strict=True
        )
        turned = [np.einsum("mrc,ic->mir", np.array(rotations), part.vertices) for part in record.body.parts]
        parts = list(zip(turned, (part.radius for part in record.body.parts), strict=True))
        shift = np.array(translations)[:, None, :]
        rooms = np.min([room_in_regions(corners + shift, radius, record.regions) for corners, radius in parts], axis=0)
        extents = [
            np.max([(corners @ region.halfspaces[0].T).max(axis=1) + radius for corners, radius in parts], axis=0)
            for region in record.regions
        ]
        return rooms, extents

    # ---------------------------------------------------------------- margins and the proof

    def follow_times(self) -> None:
        """State the rows anew over the times that there are now; margins start again."""
        self.times.clear()
        self.margin.clear()
        self.inside.clear()
        self._contain()

    def set_margin(self, interval: int, margin: float) -> None:
        """Raise the margin to at least a given one, at all times of an interval whose pose is not fixed.

        Parameters
        ----------
        interval : int
            Position of the interval.
        margin : float
        """
        if not (math.isfinite(margin) and margin >= 0):
            raise ObstacleError(f"{self._what}: the margin of interval {interval} is {margin!r}; it must be >= 0.")
        for time in self.motion.intervals[interval]:
            # No plan moves a fixed pose: its rows could not hold with a margin.
            if not all(variable.fixed for variable in variables_of(self.record.poses[time])):
                self.margin[time] = max(float(margin), value(self.margin[time]))

    def verify(self, tolerance: float | None = None, *, equations: bool = True) -> SafetyReport:
        """Check the motion that the current values describe, at all times between the points.

        Each side of the region bounds a half-space that the body keeps clear of. In a union, at each instant each
        convex part has to be inside one of the regions.

        Parameters
        ----------
        tolerance : float, optional
            How much of the clearance may be missing; by default 1 % of it, or without clearance a millionth of the
            body's size.
        equations : bool
            Whether the motion that the equations make of the plan's controls is proven as well.
        """
        record = self.record
        asked = float(value(self.clearance))
        size = _size(record.body)
        # A proof needs a positive clearance: where the user asks for none, sides are moved outwards.
        moved = 0.0 if asked > 0 else size
        if tolerance is None:
            tolerance = 0.01 * asked if asked > 0 else 1e-6 * size
        if len(record.regions) > 1 and self.motion.intervals:
            return verify_inside(self.motion, record.body, record.regions, asked, tolerance, equations=equations)
        if len(record.regions) > 1:
            return self._at_points(asked, tolerance)
        scene = {"body": record.body}
        for number, (outwards, offset) in enumerate(zip(*record.regions[0].halfspaces, strict=True), start=1):
            beyond = Polytope.from_halfspaces([-outwards], [-offset - moved], bounded=False, name=f"side {number}")
            scene[beyond.name] = Body(beyond)
        pairs = {("body", name): asked + moved for name in scene if name != "body"}
        report = verify_clearance(self.motion, scene, pairs, tolerance=tolerance, equations=equations)
        return (
            replace(report, body_pairs=tuple(_moved_back(pair, moved) for pair in report.body_pairs))
            if moved
            else report
        )

    def _at_points(self, asked: float, tolerance: float) -> SafetyReport:
        """The rooms at points without an order, between which there is no motion."""
        record = self.record
        room = self._rooms_and_extents()[0].max(axis=1)
        outside = f"outside of {len(record.regions)} regions"
        required = np.full(len(room), asked)
        pair = BodyPairSafety.at_points("body", outside, record.times, room, required, tolerance)
        return SafetyReport((pair,), between=False, motion=self.motion.description({"body": record.body}))


@ModelComponentFactory.register("A body that stays inside a convex region, or a union of such.")
class Containment(MotionBlock, data=ContainmentData):
    """A body that stays inside a convex region, or inside the union of several, over a set of times.

    Parameters
    ----------
    points : Set, ContinuousSet or sequence of numbers
        As for `ObstacleAvoidanceBlock`. With `rule`, index sets take its place.
    body : Polytope, list of Polytope or Body
    pose : callable
        ``pose(block, t)``, unless `body` is a `Body`, which has it.
    between_points : callable, optional
        ``between_points(block, t, fraction)``, as for `Body`.
    region : Polytope or sequence of Polytope
        The inside of the region; bounded or not. Several are a union, such as a corridor: on each interval the body is
        inside one of them, and where it changes from one to the next it is inside both. The initial guess chooses
        which; `solve` revises the choice.
    clearance : float
        Distance kept from the sides; 0 by default.
    rule : callable, optional
        ``rule(block, *index)`` calls ``block.build(points, body=..., ...)``; for indexed blocks.

    Raises
    ------
    ObstacleError
        When body and region do not fit; the block is then not added to the model.

    Notes
    -----
    One row ``C_k.(R V_i + t) <= e_k - clearance - radius`` per time, corner and side; no other variables. Between the
    times, straight paths of the corners stay inside. `verify` checks paths that are not straight, and `solve` adds
    margins where they leave the region.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> m = pyo.ConcreteModel()
    >>> m.move = rcp.PhaseBlock(duration=1.0, elements=10)
    >>> m.move.x, m.move.y = rcp.State(initial=0, final=4), rcp.State(initial=0, final=0)
    >>> m.move.inside = rcp.Containment(
    ...     m.move.time,
    ...     body=rcp.Polytope.box(0.5, 0.5),
    ...     pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t]),
    ...     region=rcp.Polytope.box(6, 1, center=(2, 0)),
    ... )
    >>> m.move.initialize_straight_lines()
    >>> m.move.inside.verify().safe
    True
    """

    def __init__(
        self,
        *points: Any,
        body: Any = None,
        pose: Rule | None = None,
        region: Polytope | Sequence[Polytope] | None = None,
        clearance: float = 0.0,
        between_points: Rule | None = None,
        rule: Rule | None = None,
        **block_options: Any,
    ) -> None:
        options = {
            "body": body,
            "pose": pose,
            "between_points": between_points,
            "region": region,
            "clearance": clearance,
        }
        indexes, built_from = sort_arguments("a Containment", points, options, rule)
        super().__init__(*indexes, **built_from, **block_options)


def _moved_back(pair: BodyPairSafety, moved: float) -> BodyPairSafety:
    """The result for a side at its original position."""
    return replace(
        pair,
        clearance=pair.clearance - moved,
        distance=pair.distance - moved,
        proven=pair.proven - moved,
        interval_distance=pair.interval_distance - moved,
        interval_proven=pair.interval_proven - moved,
        interval_clearance=pair.interval_clearance - moved,
    )


def _checked_body(label: str, body: Any, pose: Any, between_points: Any) -> Body:
    if isinstance(body, Body) and pose is None and between_points is None:
        moving = body
    elif body is None or isinstance(body, Body):
        raise ObstacleError(f"{label}: give body=Polytope and pose=rule, or body=Body(shape, pose=rule).")
    else:
        moving = Body(body, pose, between_points)
    if not moving.moves:
        raise ObstacleError(f"{label}: the body has no pose=rule, which says where it is: rule(block, t) -> Pose.")
    for name, part in moving.named_parts("body"):
        if not part.is_bounded:
            raise ObstacleError(f"{label}: '{name}' is unbounded; only an unbounded region could contain it.")
    return moving


def _size(body: Body) -> float:
    return max(float(np.ptp(part.vertices, axis=0).max()) + part.radius for part in body.parts) or 1.0


def _checked_regions(label: str, region: Any, body: Body) -> tuple[Polytope, ...]:
    given = (region,) if isinstance(region, Polytope) else region
    if not (isinstance(given, (list, tuple)) and given and all(isinstance(shape, Polytope) for shape in given)):
        raise ObstacleError(
            f"{label}: region is {region!r}; expected a Polytope, bounded or not, such as "
            "rcp.Polytope.from_vertices(corners), or a list of them."
        )
    for shape in given:
        _check_region(label, shape, body)
    return tuple(given)


def _check_region(label: str, region: Polytope, body: Body) -> None:
    if region.dimension != body.dimension:
        raise ObstacleError(
            f"{label}: the region '{region.name}' has dimension {region.dimension}, the body {body.dimension}."
        )
    if region.is_flat:
        raise ObstacleError(f"{label}: the region '{region.name}' is flat; nothing fits into it.")
    if region.radius > 0:
        raise ObstacleError(
            f"{label}: the region '{region.name}' has a radius of {region.radius:g}. Rounded corners have no "
            "half-spaces: give the region without it."
        )
