"""`Motion`: the points of a motion, and what the values of variables at nodes say of the motion between them.

On every interval a signal is a polynomial of the local fraction ``s`` in [0, 1], ``x(s) = sum_k w_k(s) leaf_k``. The
leaves are the variables at the nodes. For schemes whose first stage is the start of the element they are the start
value and the increments ``h f``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Callable
from typing import Any

import numpy as np
from pyomo.core.base.param import Param
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.templates.slots import Item

from .rules_along_motion import checked_pose, expressions_between, item_at, pose_formulas, rule_at_node

Nodes = tuple[tuple[float, ...], ...]


class Motion(ABC):
    """A set of points and the motion between them; made by `motion_of`.

    Attributes
    ----------
    block : Block
        First argument of pose rules.
    points : tuple
        Members of the set.
    intervals : tuple of tuples
        Nodes of each interval, both ends included; none where there is no motion between the points.
    is_assumed : bool
        Whether nothing in the model says that the motion between the nodes is this one.
    phase : PhaseBlock or None
        Whose states move along the points.
    has_equations : bool
        Whether the equations of the motion, where it has any, are on the model.
    """

    block: Any
    points: tuple[Any, ...]
    intervals: Nodes
    is_assumed: bool = False
    phase: Any = None
    has_equations: bool = True

    @property
    @abstractmethod
    def description(self) -> str:
        """What the motion between the points is, and how that is known, in words."""

    @abstractmethod
    def refuse(self, signal: Item, *, early: bool = False) -> None:
        """Raise `ObstacleError` for a signal whose polynomial is not continuous.

        Parameters
        ----------
        signal : Item
        early : bool
            True while the model is still being stated: what ties two durations may come later.
        """

    @abstractmethod
    def polynomial(self, signal: Item, interval: int) -> tuple[Any, list[Any]]:
        """Local fractions of one interval, and the variables and expressions there that its polynomial goes through."""

    def joins_lines(self, signal: Item) -> bool:
        """Whether a signal has values at the nodes only, which are joined by lines: parameters over the nodes."""
        return signal.component.ctype is Param

    def check(self, signal: Item, *, early: bool = False) -> None:
        """Raise `ObstacleError` for a signal that is not continuous; `early` as for `refuse`."""
        if not self.joins_lines(signal):
            self.refuse(signal, early=early)

    def polynomial_around(self, signal: Item, interval: int, fraction: float) -> tuple[Any, list[Any]]:
        """The polynomial that a signal follows at a local fraction; of one that is joined by lines, the line there."""
        if not self.joins_lines(signal):
            return self.polynomial(signal, interval)
        fractions = self.local_fractions(interval)
        k = min(bisect_right(fractions, fraction), len(fractions) - 1)
        return fractions[k - 1 : k + 1], [item_at(signal, node) for node in self.intervals[interval][k - 1 : k + 1]]

    def check_time_of(self, phase: Any) -> None:
        """Raise `ObstacleError` where ``phase.time_at`` does not map the indices to time."""
        raise ObstacleError(f"time_at(t) is read from '{phase.name}', whose time is not that of the set of points.")

    def time_at(self, index: float) -> Any:
        """Time at an index: a number or an expression."""
        return index

    def node_times(self) -> dict[float, float]:
        """The time of every node, as a number."""
        # Between the boundaries of an element time is linear in the index.
        times: dict[float, float] = {}
        for nodes in self.intervals:
            start, end = (float(value(self.time_at(node))) for node in (nodes[0], nodes[-1]))
            for node in nodes:
                times[node] = start + (node - nodes[0]) / (nodes[-1] - nodes[0]) * (end - start)
        return times

    @property
    def interval_ends(self) -> Array:
        """Times of the start and the end of each interval, shape ``(intervals, 2)``."""
        times = self.node_times()
        return np.array([[times[nodes[0]], times[nodes[-1]]] for nodes in self.intervals])

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
        index = self.index_at(interval, fraction)
        if index in self.intervals[interval]:
            return self.pose_at_node(rule, index, name=name)
        return expressions_between(self, pose_formulas(self, rule, name), interval, fraction, what)
