"""`Motion`: the points of a motion, and the interpolation between them."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from pyomo.dae import ContinuousSet

from pyrobocop_pyomo.continuous.record import discretisation_of
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.phases import PhaseBlockData
from pyrobocop_pyomo.rules.slots import Item

from .interpolation import (
    ALONE,
    ContinuousSetInterpolation,
    Interpolation,
    NodalInterpolation,
    PhaseInterpolation,
    dae_interpolation,
    item_at,
    parent_of,
)
from .rules_along_motion import checked_pose, expressions_between, pose_formulas, rule_at_node


@dataclass(frozen=True, eq=False)
class Motion:
    """A set of points and the motion between them; made by `motion_of`.

    Attributes
    ----------
    block : Block
        First argument of pose rules.
    points : tuple
        Members of the set.
    interpolation : Interpolation
        Without intervals for points that are not ordered in time: there is no motion between them.
    """

    block: Any
    points: tuple[Any, ...]
    interpolation: Interpolation

    @property
    def intervals(self) -> tuple[tuple[float, ...], ...]:
        """Nodes of each interval, both ends included; empty where there is no motion between the points."""
        return self.interpolation.intervals

    @property
    def nodes(self) -> list[float]:
        """All nodes of the intervals, in order."""
        return sorted({node for nodes in self.intervals for node in nodes})

    def local_fractions(self, interval: int) -> tuple[float, ...]:
        """Positions of the nodes within an interval, from 0 to 1."""
        nodes = self.intervals[interval]
        return tuple((node - nodes[0]) / (nodes[-1] - nodes[0]) for node in nodes)

    def index_at(self, interval: int, fraction: float) -> float:
        """Index at a local fraction of an interval; exactly the node where the fraction is one of a node."""
        nodes = self.intervals[interval]
        local = self.local_fractions(interval)
        nearest = min(range(len(nodes)), key=lambda k: abs(local[k] - fraction))
        if abs(local[nearest] - fraction) <= ROUNDING:
            return nodes[nearest]
        return float(nodes[0] + fraction * (nodes[-1] - nodes[0]))

    @property
    def phase(self) -> Any:
        """The phase whose states move along the points; None where there is none."""
        return self.interpolation.phase

    @property
    def description(self) -> str:
        """What the motion between the points is, and how that is known, in words."""
        return self.interpolation.description

    @property
    def is_assumed(self) -> bool:
        """Whether nothing in the model says that bodies move like this."""
        return self.interpolation.is_assumed

    def time_at(self, index: Any) -> Any:
        """Time at an index: the index itself, or an expression where the duration is free."""
        return self.interpolation.time_at(index)

    def pose_at_node(self, rule: Callable[..., Any], t: Any, *, name: str = "body") -> Any:
        """Pose at a point of the set, or at a node of an interval.

        Raises
        ------
        ObstacleError
            Naming the body and the time, when the rule has no result there, or no pose.
        """
        with rule_at_node(self, rule, f"the pose of '{name}'", t):
            return checked_pose(rule(self.block, t), self.block, name)

    def pose_at(self, rule: Callable[..., Any], interval: int, fraction: float, *, name: str = "body") -> Any:
        """Pose at a local fraction of an interval, in expressions of the variables at the nodes.

        Parameters
        ----------
        rule : callable
            ``rule(block, t)``, as for a `Body`.
        interval : int
            Position of the interval.
        fraction : float
            From 0 at its start to 1 at its end. At a node the result is that of `pose_at_node`.
        name : str
            Name of the body in messages.

        Raises
        ------
        ObstacleError
            When the pose reads a signal that is not continuous, or the rule cannot be evaluated between nodes.
        """
        what = f"the pose of '{name}'"
        if not self.intervals:
            raise ObstacleError(f"{what} between points: these points are not ordered in time.")
        if not 0.0 <= fraction <= 1.0:
            raise ObstacleError(f"{what} at fraction {fraction!r} of an interval; expected 0 to 1.")
        index = self.index_at(interval, fraction)
        if index in self.intervals[interval]:
            return self.pose_at_node(rule, index, name=name)
        return expressions_between(self, pose_formulas(self, rule, name), interval, fraction, what)


def motion_of(point_set: Any, parent_block: Any) -> Motion:
    """The motion over a set of points.

    Parameters
    ----------
    point_set : Set or sequence
        ``time`` or ``points`` of a `PhaseBlock`, or a discretised `ContinuousSet`: intervals are the elements, and
        states follow the collocation polynomial. Numbers in increasing order: two consecutive points are an interval,
        on which everything that is indexed by the set changes linearly. Anything else: there are no intervals.
    parent_block : Block
        First argument of pose rules.

    Raises
    ------
    ObstacleError
        For a continuous set that is not discretised, and for numbers that do not increase.
    """
    if getattr(point_set, "ctype", None) is ContinuousSet:
        return Motion(parent_block, tuple(point_set), _continuous_interpolation(point_set))
    home = point_set.parent_block() if hasattr(point_set, "parent_block") else None
    if isinstance(home, PhaseBlockData) and (point_set is home.time or point_set is home.points):
        return Motion(parent_block, tuple(point_set), PhaseInterpolation(home))
    points = tuple(point_set)
    if not _is_ordered(point_set) or not all(map(_is_number, points)):
        return Motion(parent_block, points, ALONE)
    for before, after in itertools.pairwise(points):
        if not before < after:
            raise ObstacleError(
                f"'{getattr(point_set, 'name', 'points')}': points that are numbers are times and must increase, "
                f"but {before:g} is followed by {after:g}. Sort them, or use names for points without an order."
            )
    if len(points) < 2:
        return Motion(parent_block, points, ALONE)
    intervals = tuple(itertools.pairwise(points))
    return Motion(parent_block, points, NodalInterpolation(intervals, intervals, _refuse_sampled_states(points[0])))


def _continuous_interpolation(domain: Any) -> Interpolation:
    ours = discretisation_of(domain)
    return dae_interpolation(domain) if ours is None else ContinuousSetInterpolation(ours)


def _is_ordered(point_set: Any) -> bool:
    if isinstance(point_set, (list, tuple, range, np.ndarray)):
        return True
    return bool(getattr(point_set, "isordered", bool)())


def _is_number(point: Any) -> bool:
    return isinstance(point, Real) and not isinstance(point, bool)


def _refuse_sampled_states(point: float) -> Callable[[Item], None]:
    """What has a motion of its own must not be read at plain numbers: lines between them would hide that motion."""

    def refuse(signal: Item) -> None:
        data = item_at(signal, point)
        # Through a reference the variable is that of another component.
        component = parent_of(data) or signal.component
        owner = component.parent_block()
        if isinstance(owner, PhaseBlockData):
            raise ObstacleError(
                f"'{signal.name}' belongs to phase '{owner.name}', whose states do not change linearly between points. "
                f"Give '{owner.name}.time' as the set of points."
            )
        for subset in component.index_set().subsets():
            phase = subset.parent_block()
            if subset.ctype is ContinuousSet or isinstance(phase, PhaseBlockData):
                raise ObstacleError(
                    f"'{signal.name}' is indexed by '{subset.name}', along which it moves in a way that plain numbers "
                    f"do not tell. Give '{subset.name}' itself as the set of points, not a list of its members."
                )

    return refuse
