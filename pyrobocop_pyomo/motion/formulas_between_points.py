"""`FormulaTemplate`: a pose that the user's own formula gives between two points, on many subintervals at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import Var
from pyomo.core.expr import LinearExpression, MonomialTermExpression
from pyomo.core.expr.numvalue import native_numeric_types, value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.numerics.interval_arithmetic import Interval
from pyrobocop_pyomo.numerics.taylor_forms import TaylorForm

from .bodies import Body
from .motion import Motion
from .pose_templates import PiecewisePolynomial, SignalFormulas, entry_values


@dataclass(frozen=True, eq=False)
class FormulaTemplate:
    """The formulas that `Body.between_points` gives; made by `formula_template`.

    Attributes
    ----------
    name : str
        Name of the body in messages.
    parts : tuple of SignalFormulas
        Each covers some intervals: one covers all where the formula is built alike on each.
    part_of : array, shape (intervals,)
        Position of the template of each interval.
    ends : array, shape (intervals, 2, d * d + d)
        Entries of the pose by the rule for the points, at the start and at the end of each interval.
    """

    name: str
    parts: tuple[SignalFormulas, ...]
    part_of: Indices
    ends: Array

    @property
    def parameters(self) -> tuple[str, ...]:
        """None: the formula is the user's own."""
        return ()

    def values(self, interval: Indices, fraction: Array) -> Array:
        """Entries at local fractions of intervals, shape ``(m, d * d + d)``."""
        found = np.empty((len(interval), self.ends.shape[2]))
        for part, template in enumerate(self.parts):
            chosen = np.flatnonzero(self.part_of[interval] == part)
            if len(chosen):
                found[chosen] = template.values(interval[chosen], fraction[chosen])
        return found

    def taylor_forms(self, interval: Indices, start: Array, end: Array) -> list[TaylorForm]:
        """Bounds of the entries and their derivatives on subintervals."""
        if len(self.parts) == 1:
            return self.parts[0].taylor_forms(interval, start, end)
        bounds = np.empty((self.ends.shape[2], 6, len(interval)))
        for part, template in enumerate(self.parts):
            chosen = np.flatnonzero(self.part_of[interval] == part)
            if len(chosen):
                forms = template.taylor_forms(interval[chosen], start[chosen], end[chosen])
                for row, form in zip(bounds, forms, strict=True):
                    orders = (form.value, form.first, form.second)
                    row[:, chosen] = [bound for order in orders for bound in (order.low, order.high)]
        return [TaylorForm(*(Interval(*row[2 * k : 2 * k + 2]) for k in range(3))) for row in bounds]

    def mismatch(self, motion: Motion) -> tuple[Indices, Array]:
        """Differences of the poses at the points from those that the formula has at both ends of each interval.

        The formula steps from point to point by the user's own equations: where the values violate these, or where the
        formula is another one, the motion jumps.
        """
        count = len(self.part_of)
        interval = np.repeat(np.arange(count), 2)
        found = self.values(interval, np.tile([0.0, 1.0], count))
        return interval, self.ends.reshape(2 * count, -1) - found


def formula_template(motion: Motion, body: Body, name: str) -> FormulaTemplate:
    """Ask the formula of a body for each interval.

    Raises
    ------
    ObstacleError
        Naming the body, when the formula cannot be asked with an expression as its fraction, gives no pose, or reads
        what has no value.
    """
    assert body.pose is not None
    motion.check_formula(body, name)
    scratch = ConcreteModel()
    scratch.fraction = Var()
    intervals = motion.intervals
    poses = [_pose(motion, body, name, nodes[0], scratch.fraction) for nodes in intervals]
    rows = [pose.entries for pose in poses]
    everywhere = np.arange(len(intervals))
    parts: tuple[SignalFormulas, ...]
    try:
        parts = (_template(scratch, name, rows, everywhere, len(intervals)),)
        part_of = np.zeros(len(intervals), dtype=np.intp)
    except _BuiltDifferently:
        # A formula that is not the same everywhere, such as one with an ``if`` on t.
        parts = tuple(_template(scratch, name, [row], np.array([k]), len(intervals)) for k, row in enumerate(rows))
        part_of = everywhere
    nodes = {node: entry_values(motion.pose_at_node(body.pose, node, name=name).entries) for node in motion.points}
    ends = np.array([[nodes[start], nodes[end]] for start, end in intervals])
    return FormulaTemplate(name, parts, part_of, ends)


def _pose(motion: Motion, body: Body, name: str, point: Any, fraction: Any) -> Pose:
    assert body.between_points is not None
    try:
        pose = body.between_points(motion.block, point, fraction)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".splitlines()[0].rstrip(".")
        raise ObstacleError(
            f"between_points of '{name}' cannot be asked at t = {point!r} ({reason}). It is rule(block, t, fraction) "
            "and has to be made of Pyomo's functions, pyo.cos instead of math.cos, with no 'if' on the fraction."
        ) from error
    if not isinstance(pose, Pose) or pose.dimension != body.dimension:
        raise ObstacleError(
            f"between_points of '{name}' returned {pose!r}; expected a Pose in {body.dimension} dimensions, by "
            f"{'planar_pose' if body.dimension == 2 else 'spatial_pose'}."
        )
    return pose


class _BuiltDifferently(Exception):
    """Two intervals have formulas of different structure."""


def _template(scratch: Any, name: str, rows: list[list[Any]], intervals: Indices, count: int) -> SignalFormulas:
    """One template for intervals whose formulas differ in their variables and numbers only.

    Parameters
    ----------
    scratch : ConcreteModel
        Has ``fraction``; gets the placeholders.
    rows : list of lists
        Entries of the pose, for each of the intervals.
    intervals : array
    count : int
        How many intervals there are in all.
    """
    merged = _Merged(scratch, name, intervals, count)
    entries = [merged.of([row[k] for row in rows]) for k in range(len(rows[0]))]
    ramp = np.tile([0.0, 1.0], (count, 1))
    slope = (np.ones((count, 1)), np.zeros((count, 1)))
    fraction = PiecewisePolynomial(scratch.fraction, lambda node: np.nan, (ramp, *slope))
    return SignalFormulas(f"the pose of '{name}'", entries, (fraction, *merged.signals), (), scratch)


class _Merged:
    """Expressions that are built alike as one expression, with a placeholder wherever they differ."""

    def __init__(self, scratch: Any, name: str, intervals: Indices, count: int) -> None:
        self.signals: list[PiecewisePolynomial] = []
        self._scratch, self._name, self._intervals, self._count = scratch, name, intervals, count
        # What is known stays alive: its identity is the key.
        self._known: dict[tuple[int, ...], tuple[list[Any], Any]] = {}

    def of(self, nodes: list[Any]) -> Any:
        """One expression for all."""
        key = tuple(map(id, nodes))
        if key not in self._known:
            self._known[key] = (nodes, self._merged(nodes))
        return self._known[key][1]

    def _merged(self, nodes: list[Any]) -> Any:
        first = nodes[0]
        numbers = [node.__class__ in native_numeric_types for node in nodes]
        if all(numbers):
            return first if all(node == first for node in nodes) else self._placeholder(nodes)
        if any(numbers):
            return self._placeholder_of_leaves(nodes)
        if not first.is_expression_type():
            if first is self._scratch.fraction and all(node is first for node in nodes):
                return first
            return self._placeholder_of_leaves(nodes)
        if first.is_named_expression_type():
            return self.of([_alike(first, node).arg(0) for node in nodes])
        arguments = [
            self.of(list(column)) for column in zip(*(_alike(first, node).args for node in nodes), strict=True)
        ]
        if isinstance(first, MonomialTermExpression):
            return arguments[0] * arguments[1]
        if isinstance(first, LinearExpression):
            return sum(arguments)
        return first.create_node_with_local_data(tuple(arguments))

    def _placeholder_of_leaves(self, nodes: list[Any]) -> Any:
        for node in nodes:
            if node is self._scratch.fraction or (
                node.__class__ not in native_numeric_types and node.is_expression_type()
            ):
                raise _BuiltDifferently
        return self._placeholder(nodes)

    def _placeholder(self, leaves: list[Any]) -> Any:
        numbers = []
        for leaf in leaves:
            number = value(leaf, exception=False)
            if number is None:
                raise ObstacleError(
                    f"between_points of '{self._name}' reads '{leaf.name}', which has no value. Solve the model first, "
                    "or give it an initial guess."
                )
            numbers.append(float(number))
        placeholder = Var()
        self._scratch.add_component(f"leaf_{len(self._scratch.component_map())}", placeholder)
        constant = np.zeros((self._count, 1))
        constant[self._intervals, 0] = numbers
        zero = np.zeros((self._count, 1))
        self.signals.append(PiecewisePolynomial(placeholder, lambda node: np.nan, (constant, zero, zero)))
        return placeholder


def _alike(first: Any, node: Any) -> Any:
    same = (
        node.__class__ is first.__class__
        and len(node.args) == len(first.args)
        and getattr(node, "_name", None) == getattr(first, "_name", None)
    )
    if not same:
        raise _BuiltDifferently
    return node
