"""`Containment`: a body that stays inside a convex region, as an ordinary Pyomo block."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pyomo.core.base.component import ModelComponentFactory
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.param import Param
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.set import Set
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.modeling.blocks import BuiltBlock, BuiltBlockData, Rule
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.motion.clearance_proof import verify_clearance
from pyrobocop_pyomo.motion.motion import Motion, motion_of
from pyrobocop_pyomo.motion.safety_report import BodyPairSafety, SafetyReport

from .block_arguments import set_of_points, sort_arguments
from .formulations.rows import dot
from .snapshot import variables_of


@dataclass
class ContainmentRecord:
    """The facts behind a `Containment`."""

    body: Body
    region: Polytope
    points: Any
    times: tuple[Any, ...]
    poses: dict[Any, Pose]


class ContainmentData(BuiltBlockData):
    """One containment; see `Containment` for how to make one.

    Attributes
    ----------
    inside : Constraint
        ``inside[t, corner, side]``: every corner inside every side of the region.
    clearance : Param
        Distance kept from the sides; mutable.
    margin : Param
        By time: added to the clearance, for the motion between the times.
    """

    _kind = "containment"
    _error = ObstacleError

    @property
    def record(self) -> ContainmentRecord:
        """Body, region and poses behind this block."""
        return self._record_if_built()

    @property
    def motion(self) -> Motion:
        """The motion over the set of points."""
        return motion_of(self.record.points, self.parent_block())

    def build(self, points: Any, **options: Any) -> None:
        """Build the block; for rules of indexed blocks, with the arguments of the class.

        Raises
        ------
        ObstacleError
            When the arguments contradict themselves; nothing is then left on the block.
        """
        self._build_once(points, **options)

    def _build(
        self, points: Any, *, body: Any = None, pose: Any = None, region: Any = None, clearance: float = 0.0
    ) -> None:
        points = set_of_points(self, points)
        moving = _checked_body(self._what, body, pose)
        sides, offsets = _checked_region(self._what, region, moving)
        if not (isinstance(clearance, (int, float)) and math.isfinite(clearance) and clearance >= 0):
            raise ObstacleError(f"{self._what}: the clearance is {clearance!r}; it must be a length >= 0.")
        motion = motion_of(points, self.parent_block())
        times = tuple(dict.fromkeys(t for nodes in motion.intervals for t in nodes)) or motion.points
        poses = {time: motion.pose_at_node(moving.pose, time) for time in times} if moving.pose is not None else {}
        self._record = ContainmentRecord(moving, region, points, times, poses)
        self.clearance = Param(initialize=float(clearance), mutable=True, doc="distance kept from the sides")
        self.times = Set(initialize=list(times), ordered=True, doc="times at which corners have rows")
        self.margin = Param(self.times, mutable=True, initialize=0.0, doc="added to the clearance")
        self.inside = Constraint(AnyIndex, doc="corners inside the sides of the region")
        corners = [(corner, part.radius) for part in moving.parts for corner in part.vertices.tolist()]
        for time, placed in poses.items():
            room = self.clearance + self.margin[time]
            for number, (corner, radius) in enumerate(corners):
                point = placed.apply(corner)
                for side, (outwards, offset) in enumerate(zip(sides.tolist(), offsets.tolist(), strict=True)):
                    self.inside.add((time, number, side), (None, dot(outwards, point) + room, offset - radius))

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

    def verify(self, tolerance: float | None = None) -> SafetyReport:
        """Check the motion that the current values describe, at all times between the points.

        Each side of the region bounds a half-space that the body keeps clear of.

        Parameters
        ----------
        tolerance : float, optional
            How much of the clearance may be missing; by default 1 % of it, or without clearance a millionth of the
            body's size.
        """
        record = self.record
        asked = float(value(self.clearance))
        size = max(float(np.ptp(part.vertices, axis=0).max()) + part.radius for part in record.body.parts) or 1.0
        # A proof needs a positive clearance: where the user asks for none, sides are moved outwards.
        moved = 0.0 if asked > 0 else size
        if tolerance is None:
            tolerance = 0.01 * asked if asked > 0 else 1e-6 * size
        scene = {"body": record.body}
        for number, (outwards, offset) in enumerate(zip(*record.region.halfspaces, strict=True), start=1):
            beyond = Polytope.from_halfspaces([-outwards], [-offset - moved], bounded=False, name=f"side {number}")
            scene[beyond.name] = Body(beyond)
        pairs = {("body", name): asked + moved for name in scene if name != "body"}
        report = verify_clearance(self.motion, scene, pairs, tolerance=tolerance)
        return (
            replace(report, body_pairs=tuple(_moved_back(pair, moved) for pair in report.body_pairs))
            if moved
            else report
        )


@ModelComponentFactory.register("A body that stays inside a convex region.")
class Containment(BuiltBlock, data=ContainmentData):
    """A body that stays inside a convex region, over a set of times.

    Parameters
    ----------
    points : Set, ContinuousSet or sequence of numbers
        As for `ObstacleAvoidanceBlock`. With `rule`, index sets take its place.
    body : Polytope, list of Polytope or Body
    pose : callable
        ``pose(block, t)``, unless `body` is a `Body`, which has it.
    region : Polytope
        The inside of the region; bounded or not.
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
        region: Polytope | None = None,
        clearance: float = 0.0,
        rule: Rule | None = None,
        **block_options: Any,
    ) -> None:
        options = {"body": body, "pose": pose, "region": region, "clearance": clearance}
        indexes, built_from = sort_arguments("a Containment", points, options, rule)
        super().__init__(*indexes, **built_from, **block_options)

    @classmethod
    def _is_scalar(cls, args: tuple[Any, ...], keywords: Mapping[str, Any]) -> bool:
        return keywords.get("rule") is None or not args


def _moved_back(pair: BodyPairSafety, moved: float) -> BodyPairSafety:
    """The result for a side at its original position."""
    return replace(
        pair,
        clearance=pair.clearance - moved,
        distance=pair.distance - moved,
        proven=pair.proven - moved,
        interval_distance=pair.interval_distance - moved,
        interval_proven=pair.interval_proven - moved,
    )


def _checked_body(what: str, body: Any, pose: Any) -> Body:
    if isinstance(body, Body) and pose is None:
        moving = body
    elif body is None or isinstance(body, Body):
        raise ObstacleError(f"{what}: give body=Polytope and pose=rule, or body=Body(shape, pose=rule).")
    else:
        moving = Body(body, pose=pose)
    if not moving.moves:
        raise ObstacleError(f"{what}: the body has no pose=rule, which says where it is: rule(block, t) -> Pose.")
    for name, part in moving.named_parts("body"):
        if not part.is_bounded:
            raise ObstacleError(f"{what}: '{name}' is unbounded; only an unbounded region could contain it.")
    return moving


def _checked_region(what: str, region: Any, body: Body) -> tuple[np.ndarray, np.ndarray]:
    if not isinstance(region, Polytope):
        raise ObstacleError(f"{what}: region is {region!r}; expected a Polytope, bounded or not.")
    if region.dimension != body.dimension:
        raise ObstacleError(
            f"{what}: the region '{region.name}' has dimension {region.dimension}, the body {body.dimension}."
        )
    if region.is_flat:
        raise ObstacleError(f"{what}: the region '{region.name}' is flat; nothing fits into it.")
    if region.radius > 0:
        raise ObstacleError(
            f"{what}: the region '{region.name}' has a radius of {region.radius:g}. Rounded corners have no "
            "half-spaces: give the region without it."
        )
    return region.halfspaces
