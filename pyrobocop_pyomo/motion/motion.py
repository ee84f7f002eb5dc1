"""`Motion`: the points at which a body has to be clear of obstacles, and how it moves between them."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from pyomo.core.expr import LinearExpression
from pyomo.core.expr.numvalue import is_potentially_variable
from pyomo.dae import ContinuousSet

from pyrobocop_pyomo.continuous.record import discretisation_of
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.rule_proxies import Series, ask
from pyrobocop_pyomo.phases import PhaseBlockData

from .dae_intervals import dae_interpolation
from .interpolation import CollocationInterpolation, Interpolation, NodalInterpolation
from .sources import ContinuousSetSource, PhaseSource, parent_of

# A local fraction this close to a node is the node.
_AT_NODE = 1e-12


@dataclass(frozen=True, eq=False)
class Motion:
    """What happens between the points of a set; `motion_of` makes it.

    Attributes
    ----------
    block : Block
        What rules for poses are asked with.
    points : tuple
        Where certificates are asked node by node: the members of the set.
    interpolation : Interpolation or None
        None for points that are not ordered in time: nothing happens between them.
    """

    block: Any
    points: tuple[Any, ...]
    interpolation: Interpolation | None

    @property
    def intervals(self) -> tuple[tuple[float, ...], ...]:
        """Node times of each interval, both ends included; none where nothing happens between points."""
        return () if self.interpolation is None else self.interpolation.intervals

    def local_fractions(self, interval: int) -> tuple[float, ...]:
        """Where the nodes of an interval lie in it, from 0 to 1."""
        nodes = self.intervals[interval]
        return tuple((node - nodes[0]) / (nodes[-1] - nodes[0]) for node in nodes)

    def index_at(self, interval: int, fraction: float) -> float:
        """The index at a local fraction of an interval: the very node where there is one."""
        nodes = self.intervals[interval]
        local = self.local_fractions(interval)
        nearest = min(range(len(nodes)), key=lambda k: abs(local[k] - fraction))
        if abs(local[nearest] - fraction) <= _AT_NODE:
            return nodes[nearest]
        return float(nodes[0] + fraction * (nodes[-1] - nodes[0]))

    def clock(self, index: Any) -> Any:
        """The time that an index stands for: itself, or an expression in what is to be found."""
        return index if self.interpolation is None else self.interpolation.clock(index)

    def pose_at_node(self, rule: Callable[..., Any], t: Any, *, name: str = "body") -> Any:
        """The rule asked at a point of the set, or at a node of an interval.

        Raises
        ------
        ObstacleError
            Naming the body and the time, when the rule has no answer there.
        """
        try:
            return rule(self.block, t)
        except KeyError as error:
            raise ObstacleError(
                f"the pose of '{name}' has no value at t = {t!r} ({error}). It is asked at every point and at the ends "
                "of every interval, where states have a value, but controls and algebraics may have none."
            ) from error

    def pose_at(self, rule: Callable[..., Any], interval: int, fraction: float, *, name: str = "body") -> Any:
        """The pose at an in-between point, of expressions in the variables at the nodes.

        Parameters
        ----------
        rule : callable
            ``rule(block, t)``, as for a `Body`.
        interval : int
            Number of the interval.
        fraction : float
            From 0 at its start to 1 at its end. At a node this is `pose_at_node`.
        name : str
            What messages call the body.

        Raises
        ------
        ObstacleError
            When the pose reads what does not move continuously, or the rule cannot be asked between nodes.
        """
        if self.interpolation is None:
            raise ObstacleError(f"the pose of '{name}' between points: these points are not ordered in time.")
        if not 0.0 <= fraction <= 1.0:
            raise ObstacleError(f"the pose of '{name}' at fraction {fraction!r} of an interval; expected 0 to 1.")
        index = self.index_at(interval, fraction)
        if index in self.intervals[interval]:
            return self.pose_at_node(rule, index, name=name)
        return ask(rule, self.block, _PointReader(self.interpolation, interval, fraction, index), name)


class _PointReader:
    """Reads the model at one point between nodes."""

    def __init__(self, interpolation: Interpolation, interval: int, fraction: float, index: float) -> None:
        self._interpolation = interpolation
        self._interval = interval
        self._fraction = fraction
        self.index = index

    def is_index(self, key: Any) -> bool:
        # By identity: another label, such as the number of a joint, may be the same number.
        return key is self.index

    def read(self, series: Series) -> Any:
        self._interpolation.check(series)
        weights = self._interpolation.weights(series, self._interval, self._fraction)[0].tolist()
        leaves = self._interpolation.leaves(series, self._interval)
        if all(_is_plain_variable(leaf) for leaf in leaves):
            return LinearExpression(linear_vars=leaves, linear_coefs=weights)
        return sum(weight * leaf for weight, leaf in zip(weights, leaves, strict=True))

    def clock(self, block: Any) -> Any:
        return block.clock(self.index)


def _is_plain_variable(leaf: Any) -> bool:
    return is_potentially_variable(leaf) and not leaf.is_expression_type()


def motion_of(point_set: Any, parent_block: Any) -> Motion:
    """How things move between the points of a set.

    Parameters
    ----------
    point_set : Set or sequence
        ``time`` or ``points`` of a `PhaseBlock`: intervals are its elements, and states follow the collocation
        polynomial. A discretised `ContinuousSet`: the same. Numbers in increasing order: each two consecutive points
        are an interval, on which everything that is indexed by the set changes linearly. Anything else: no intervals.
    parent_block : Block
        What rules for poses get as their first argument.

    Raises
    ------
    ObstacleError
        For a continuous set that is not discretised, and for numbers that do not increase.
    """
    if getattr(point_set, "ctype", None) is ContinuousSet:
        return Motion(parent_block, tuple(point_set), _continuous_interpolation(point_set))
    home = point_set.parent_block() if hasattr(point_set, "parent_block") else None
    if isinstance(home, PhaseBlockData) and any(point_set is each for each in (home.time, home.points)):
        return Motion(parent_block, tuple(point_set), CollocationInterpolation(PhaseSource(home)))
    points = tuple(point_set)
    if not _is_ordered(point_set) or not all(_is_number(each) for each in points):
        return Motion(parent_block, points, None)
    for before, after in itertools.pairwise(points):
        if not before < after:
            raise ObstacleError(
                f"'{getattr(point_set, 'name', 'points')}': points that are numbers are times and have to increase, "
                f"but {before:g} is followed by {after:g}. Sort them; where their order means nothing, use names."
            )
    if len(points) < 2:
        return Motion(parent_block, points, None)
    intervals = tuple(itertools.pairwise(points))
    return Motion(parent_block, points, NodalInterpolation(intervals, intervals, _refuse_states_of_phases(points[0])))


def _continuous_interpolation(domain: Any) -> Interpolation:
    done = discretisation_of(domain)
    return dae_interpolation(domain) if done is None else CollocationInterpolation(ContinuousSetSource(done))


def _is_ordered(point_set: Any) -> bool:
    if isinstance(point_set, (list, tuple, range, np.ndarray)):
        return True
    return bool(getattr(point_set, "isordered", bool)())


def _is_number(point: Any) -> bool:
    return isinstance(point, Real) and not isinstance(point, bool)


def _refuse_states_of_phases(point: float) -> Callable[[Series], None]:
    def check(series: Series) -> None:
        owner = parent_of(series.at(point))
        home = owner.parent_block() if owner is not None else None
        if isinstance(home, PhaseBlockData):
            raise ObstacleError(
                f"'{series.name}' belongs to phase '{home.name}', whose states do not change linearly between points. "
                f"Give '{home.name}.time' as the set of points."
            )

    return check
