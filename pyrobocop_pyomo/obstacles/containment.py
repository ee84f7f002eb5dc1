"""`Containment`: a body that stays inside a convex region, as a Pyomo block."""

from __future__ import annotations

import math
from dataclasses import replace
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
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.geometry.poses import dot
from pyrobocop_pyomo.modeling.blocks import Rule, blocks_of_kind
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.motion.safety_report import SafetyReport

from .avoidance_record import AvoidanceRecord, fixed_times
from .block_arguments import MotionBlock, MotionBlockData
from .initial_checks import check_rules
from .scene import make_scene
from .separation_rows import extent_along


class ContainmentData(MotionBlockData):
    """One containment; see `Containment` for how to make one.

    Attributes
    ----------
    inside : Constraint
        ``inside[t, corner, side]``: every corner inside every side of the region.
    clearance : Param
        Distance kept from the sides; mutable.
    margin : Param
        By time: added to the clearance, for the motion between the times.
    equations : bool
        Whether the motion that the equations make of the plan's controls has to stay inside as well.
    """

    _kind = "containment"

    def _state(
        self, points: Any, *, body: Any = None, pose: Any = None, region: Any = None, clearance: float = 0.0
    ) -> None:
        moving = _checked_body(self._what, body, pose)
        _check_region(self._what, region, moving)
        if not (isinstance(clearance, (int, float)) and math.isfinite(clearance) and clearance >= 0):
            raise ObstacleError(f"{self._what}: the clearance is {clearance!r}; it must be a length >= 0.")
        self._region, self._moved = region, _size(moving)
        # A proof needs a positive clearance: the sides that the body keeps clear of are moved outwards by its size.
        sides = {
            f"side {number}": Polytope.from_halfspaces([-outwards], [-offset - self._moved], bounded=False)
            for number, (outwards, offset) in enumerate(zip(*region.halfspaces, strict=True), start=1)
        }
        scene = make_scene(self._what, bodies={"body": moving}, obstacles=sides, body_pairs=None, exclude=())
        self.clearance = Param(initialize=float(clearance), mutable=True, doc="distance kept from the sides")
        required = dict.fromkeys(scene.clearances, self.clearance + self._moved)
        self._record = AvoidanceRecord(scene, points, per_interval=True, broad_phase=None, clearances=required)
        self.times = Set(ordered=True, doc="times at which corners have rows")
        self.margin = Param(self.times, mutable=True, doc="added to the clearance")
        self.inside = Constraint(AnyIndex, doc="corners inside the sides of the region")
        check_rules(self._what, self.motion, scene.bodies)
        self._contain()

    def _contain(self) -> None:
        """Add the rows of all times."""
        record, motion = self.record, self.motion
        moving = record.scene.bodies["body"]
        times = tuple(dict.fromkeys(t for nodes in motion.intervals for t in nodes))
        assert moving.pose is not None
        poses = {("body", time): motion.pose_at_node(moving.pose, time) for time in times}
        record.poses = poses
        self.times.update(times)
        for time in times:
            self.margin[time] = 0.0
        sides = list(zip(*(part.tolist() for part in self._region.halfspaces), strict=True))
        corners = [
            (part.radius, *corner_and_ellipsoid) for part in moving.parts for corner_and_ellipsoid in part.corners
        ]
        with PauseGC():
            for time in times:
                room = self.clearance + self.margin[time]
                for number, (radius, corner, ellipsoid) in enumerate(corners):
                    pose = poses["body", time]
                    point = pose.apply(corner)
                    for side, (outwards, offset) in enumerate(sides):
                        height = dot(outwards, point) + room
                        if ellipsoid is not None:
                            turned = [dot(column, outwards) for column in zip(*pose.rotation, strict=True)]
                            height += extent_along(turned, ellipsoid)
                        self.inside.add((time, number, side), (None, height, offset - radius))

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
        # No plan moves a fixed pose: its rows could not hold with a margin.
        fixed = fixed_times(self.record.poses, "body")
        for time in self.motion.intervals[interval]:
            if time not in fixed:
                self.margin[time] = max(float(margin), value(self.margin[time]))

    def verify(self, tolerance: float | None = None, *, equations: bool = True) -> SafetyReport:
        """Check the motion that the current values describe, at all times between the points.

        Each side of the region bounds a half-space that the body keeps clear of.

        Parameters
        ----------
        tolerance : float, optional
            How much of the clearance may be missing; by default 1 % of it, or without clearance a millionth of the
            body's size.
        equations : bool
            Whether the motion that the equations make of the plan's controls is proven as well, unless the block says
            that it need not be.
        """
        required, moved = float(value(self.clearance)), self._moved
        if tolerance is None:
            tolerance = 0.01 * required if required > 0 else 1e-6 * moved
        report = self._proven(tolerance, equations)
        moved_back = [
            replace(
                pair,
                interval_distance=pair.interval_distance - moved,
                interval_proven=pair.interval_proven - moved,
                interval_clearance=pair.interval_clearance - moved,
            )
            for pair in report.body_pairs
        ]
        return replace(report, body_pairs=tuple(moved_back))


def containments(model: Any) -> list[ContainmentData]:
    """The active containments of a model, wherever they are."""
    return blocks_of_kind(model, ContainmentData)


@ModelComponentFactory.register("A body that stays inside a convex region.")
class Containment(MotionBlock, data=ContainmentData):
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
    equations : bool
        As for `ObstacleAvoidanceBlock`.
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
        equations: bool = True,
        rule: Rule | None = None,
        **block_options: Any,
    ) -> None:
        options = {
            "body": body,
            "pose": pose,
            "region": region,
            "clearance": clearance,
            "equations": equations,
        }
        super().__init__("a Containment", *points, options=options, rule=rule, **block_options)


def _checked_body(label: str, body: Any, pose: Any) -> Body:
    if isinstance(body, Body) and pose is None:
        moving = body.of_one_model()
    elif body is None or isinstance(body, Body):
        raise ObstacleError(f"{label}: give body=Polytope and pose=rule, or body=Body(shape, pose=rule).")
    else:
        moving = Body(body, pose)
    if not moving.moves:
        raise ObstacleError(f"{label}: the body has no pose=rule, which says where it is: rule(block, t) -> Pose.")
    for name, part in moving.named_parts("body"):
        if not part.is_bounded:
            raise ObstacleError(f"{label}: '{name}' is unbounded; only an unbounded region could contain it.")
    return moving


def _size(body: Body) -> float:
    return max(float(np.ptp(part.bounding_box, axis=0).max()) for part in body.parts) or 1.0


def _check_region(label: str, region: Any, body: Body) -> None:
    if not isinstance(region, Polytope):
        raise ObstacleError(
            f"{label}: region is {region!r}; expected a Polytope, bounded or not, such as rcp.Polytope.hull(corners)."
        )
    if region.dimension != body.dimension:
        raise ObstacleError(
            f"{label}: the region '{region.name}' has dimension {region.dimension}, the body {body.dimension}."
        )
    if region.radius > 0 or region.ellipsoids is not None:
        raise ObstacleError(
            f"{label}: the region is {region}. What is round has no half-spaces: give the region sharp corners."
        )
    if region.is_flat:
        raise ObstacleError(f"{label}: the region '{region.name}' is flat; nothing fits into it.")
