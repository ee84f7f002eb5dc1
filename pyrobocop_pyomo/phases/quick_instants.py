"""Where in its elements a phase has to be looked at, since its rules change there with the time itself.

An integration with steps of its own, and a comparison at a number of instants, see nothing of a gust between them, or
of a vibration with their period. What rules say of the time is known as formulas: bounds on parts of each element tell
where these change, and the parts are halved until every formula hardly bends on each of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from pyomo.common.numeric_types import native_numeric_types

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.expression_arrays import plain_expressions
from pyrobocop_pyomo.modeling.expression_nodes import (
    CALL,
    CHOICE,
    DIVISION,
    FUNCTION,
    NUMPY_NAMES,
    POWER,
    RELATION,
    ExpressionEvaluator,
    kind_of_node,
)
from pyrobocop_pyomo.modeling.functions import function_called
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.numerics import Array, BoolArray, Grid, Indices
from pyrobocop_pyomo.numerics.bernstein import bernstein_from_samples, derivative_coefficients, restrict
from pyrobocop_pyomo.numerics.interval_arithmetic import Interval
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.numerics.taylor_forms import TaylorForm, taylor_form_of_polynomial
from pyrobocop_pyomo.trajectories import Trajectory

from .companions import indices_of
from .record import PhaseRecord, Statement, labelled_rows
from .rule_formulas import RuleFormulas

# Parts of each element at whose ends motions are compared in any case.
SAMPLES = 16
# On a part a formula changes by such a part of its whole range, or its chord is a tenth of that away from it.
_CHANGE, _CURVES = 0.1, 0.1
# Where a formula jumps parts are halved down to this length, relative to an element.
_SMALLEST = 2.0**-40
# Instants in an element, and parts of all elements together, at most.
_MOST_INSTANTS, _MOST_PARTS = 2000, 200_000

_MONOTONE = {"sinh", "asinh", "asin", "acosh", "atanh", "log10", "floor", "ceil"}
_JUDGED = {FUNCTION, POWER, DIVISION, CHOICE, RELATION, CALL}


def instants_to_look_at(
    block: Any, record: PhaseRecord, trajectory: Trajectory, indices: Grid, statements: Iterable[Statement]
) -> Array:
    """Local fractions of elements between which the rules hardly change with the time, the same for all elements.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    trajectory : Trajectory
        What rules read beside the time is that of its polynomials.
    indices : Grid
        Its grid in the time indices of the phase.
    statements : iterable of Statement
        What rules give no formula of the time for is left out.

    Returns
    -------
    array, shape (k,)
        From 0 to 1; ``SAMPLES`` equal parts where the rules do not change more quickly.

    Raises
    ------
    TrajectoryError
        Where the rules change more often than can be followed.
    """
    usual = np.linspace(0.0, 1.0, SAMPLES + 1)
    formulas = RuleFormulas(block, record, indices, trajectory.grid)
    times = {id(formulas.index), id(formulas.clock)}
    stated = [expression for statement in statements for expression in stated_formulas(formulas, statement)]
    nodes = list(changing_nodes(stated, times))
    if not nodes:
        return usual
    parts = _parts(formulas, nodes, trajectory, indices)
    jumps = parts.halved(usual)
    if len(jumps):  # parts that were halved on the way to a jump are not needed beside it
        parts.halved(np.union1d(usual, jumps))
    found = parts.fractions
    if len(found) > _MOST_INSTANTS:
        raise TrajectoryError(_too_quick(f"{len(found)} instants of each element would have to be looked at"))
    return found


def unseen_on_the_way(block: Any, record: PhaseRecord, trajectory: Trajectory, statements: Iterable[Statement]) -> str:
    """Which rule may do something along the way of a trajectory that ``SAMPLES`` instants of an element do not show.

    Quick changes with the time are found by `instants_to_look_at`. This is about places: a jet that is passed between
    two instants shows in the bounds of its formula only. A function in Python has no bounds; a table has its knots.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    trajectory : Trajectory
    statements : iterable of Statement

    Returns
    -------
    str
        The first one, in words; empty where there is none.
    """
    indices = indices_of(record, trajectory.grid)
    part = float(trajectory.grid.mesh.widths.max()) / SAMPLES
    for statement in statements:
        what = f"{statement.kind} '{statement.name}' of phase '{block.name}'"
        if not statement.is_template(block):
            return f"{what} has to know the time as a number, and may do anything between two instants."
        formulas = RuleFormulas(block, record, indices, trajectory.grid)
        stated = stated_formulas(formulas, statement)
        moving = {id(variable) for variable in formulas.at_instant.values()}
        nodes = list(changing_nodes(stated, moving))
        known = list(changing_nodes(stated, moving | {id(formulas.index), id(formulas.clock)}))
        for call in (node for node in known if kind_of_node(node.__class__) == CALL):
            cells = getattr(function_called(call), "cells", None)
            if cells is None:
                return f"{what} has '{_readable(call)}', a function of which no bounds are known."
            if _parts(formulas, list(call.args), trajectory, indices).change_by_more_than(cells):
                return f"{what} passes several knots of the table '{_readable(call)}' between two instants."
        least = [0.0] * len(nodes)
        states = [state for state, name in record.equation_of.items() if name == statement.name]
        for rate, state in zip(stated, states, strict=False):
            # What changes slowly may add up to something narrow. It counts where it moves a state, at rest as well.
            # Sums and products of signals are polynomials of a low degree, which instants show.
            if any(True for _ in changing_nodes([rate], moving)):
                nodes.append(rate)
                least.append(_CHANGE**2 / part * (1e-3 + float(np.abs(trajectory.states[state]).max())))
        parts = _parts(formulas, nodes, trajectory, indices, at_one_time=True)
        hidden = parts.hidden(np.array(least)) if nodes else None
        if hidden is not None:
            return f"{what} has '{_readable(hidden)}', which the motion may pass between two instants."
    return ""


def _readable(expression: Any) -> str:
    """A formula in the names of the phase."""
    return re.sub(r"declared\[(\w+)\]", r"\1", str(expression))


def _parts(
    formulas: RuleFormulas, nodes: list[Any], trajectory: Trajectory, indices: Grid, *, at_one_time: bool = False
) -> _Parts:
    """Parts of the elements of a trajectory, for what these nodes read along it; or with the time of each start."""
    read = variables_in_any(nodes)
    boundaries = [np.array(grid.mesh.boundaries) for grid in (indices, trajectory.grid)]
    ends = [np.stack([of[:-1], of[:-1] if at_one_time else of[1:]], axis=1) for of in boundaries]
    leaves = formulas.leaves(_polynomials(trajectory), ends[0], ends[1])
    return _Parts(nodes, {key: leaf for key, leaf in leaves.items() if key in read}, trajectory.grid.mesh.elements)


def _too_quick(why: str) -> str:
    return (
        f"its rules change so quickly with the time that the motion between the points is not known: {why}. Take "
        "more and shorter elements, or state what the quick part does on average."
    )


def stated_formulas(formulas: RuleFormulas, statement: Statement) -> list[Any]:
    """What a rule gives at any time, side by side of its rows; nothing where it gives no formulas."""
    try:
        return formulas.formulas_of(statement, partial(_sides, statement))
    except TrajectoryError:
        return []


def _sides(statement: Statement, result: Any) -> list[Any]:
    rows = (
        [result] if statement.kind == "integral" else labelled_rows(statement.kind, plain_expressions(result)).values()
    )
    return [side for row in rows for side in _formulas_in(row)]


def _formulas_in(row: Any) -> Iterator[Any]:
    """The sides of relations, and the components of vectors."""
    if isinstance(row, (list, tuple, np.ndarray)):
        for part in row:
            yield from _formulas_in(part)
    elif row is None or isinstance(row, str):
        return  # of a pair: which bound of a side is meant
    elif kind_of_node(row.__class__) == RELATION:
        yield from row.args
    else:
        yield plain_expressions(row)


def changing_nodes(expressions: Iterable[Any], times: set[int]) -> Iterator[Any]:
    """Nodes that hold one of the times and are no sums or products: what these add up is judged by itself."""
    holds: dict[int, bool] = {}
    seen: list[Any] = []  # nodes that Pyomo makes for the moment have to live on to keep their ids

    def visit(node: Any) -> Iterator[Any]:
        if node.__class__ in native_numeric_types or id(node) in holds:
            return
        seen.append(node)
        holds[id(node)] = id(node) in times
        if not node.is_expression_type():
            return
        arguments = list(node.args)
        seen.extend(arguments)
        for argument in arguments:
            yield from visit(argument)
        holds[id(node)] = any(holds.get(id(argument), False) for argument in arguments)
        if holds[id(node)] and kind_of_node(node.__class__) in _JUDGED:
            yield node

    for expression in expressions:
        yield from visit(expression)


def _polynomials(trajectory: Trajectory) -> dict[str, Any]:
    """Bernstein coefficients (N, degree + 1) of what moves, and the numbers of what does not."""
    points, to_coefficients = bernstein_from_samples(trajectory.grid.scheme.stages + 1)
    weights = trajectory.grid.scheme.stage_polynomial_at(points)
    mesh = trajectory.grid.mesh
    values = dict(trajectory.element_polynomials(points))
    values |= {name: trajectory.element_signals(name) @ weights.T for name in trajectory.signals}
    times = np.array(mesh.boundaries[:-1])[:, None] + np.array(mesh.widths)[:, None] * points
    values |= {name: np.interp(times, *knots) for name, knots in trajectory.piecewise_linear.items()}
    return {name: of @ to_coefficients.T for name, of in values.items()} | dict(trajectory.parameters)


class _Parts:
    """Parts of the elements, and how much each formula changes on them."""

    def __init__(self, nodes: list[Any], leaves: Mapping[int, Any], elements: int) -> None:
        self._nodes, self._elements = nodes, elements
        self._leaves: dict[int, Any] = {}
        for key, leaf in leaves.items():
            first = derivative_coefficients(leaf) if np.ndim(leaf) else None
            self._leaves[key] = leaf if first is None else (leaf, first, derivative_coefficients(first))

    @property
    def fractions(self) -> Array:
        """Where parts of any element start or end."""
        return np.union1d(self._start, self._end)

    def _on_samples(self) -> tuple[Array, ...]:
        """Lowest and highest value of each node on each of ``SAMPLES`` parts of all elements, and those at its ends."""
        quarters = 4  # bounds of short parts are close
        edges = np.linspace(0.0, 1.0, quarters * SAMPLES + 1)
        element = np.repeat(np.arange(self._elements), quarters * SAMPLES)
        start, end = (np.tile(of, self._elements) for of in (edges[:-1], edges[1:]))
        low, high, _ = self._bounds(element, start, end)
        low, high = (of.reshape(len(self._nodes), -1, quarters) for of in (low, high))
        at = [start[::quarters], end[quarters - 1 :: quarters]]
        first, last = (self._bounds(element[::quarters], instants, instants)[0] for instants in at)
        return low.min(axis=2), high.max(axis=2), first, last

    def change_by_more_than(self, lengths: Array) -> bool:
        """Whether one of the nodes changes by more than its length between two instants."""
        low, high, _, _ = self._on_samples()
        return not ((high - low).max(axis=1, initial=0.0) <= lengths).all()

    def hidden(self, least: Array) -> Any:
        """A node that goes beyond its values at two instants by more than is to be seen; None without any.

        Between the two is a third one: what is narrow, and happens to be met there, is narrow all the same.
        """
        low, high, first, last = self._on_samples()
        low, high = np.fmin(low[:, :-1], low[:, 1:]), np.fmax(high[:, :-1], high[:, 1:])
        first, last = first[:, :-1], last[:, 1:]
        with np.errstate(invalid="ignore"):
            width = (high.max(axis=1) - low.min(axis=1))[:, None]
            size = np.abs(first).max(axis=1)[:, None]
            seen = np.where(np.isfinite(width), np.maximum(_CHANGE * width + NEGLIGIBLE * size, least[:, None]), 0.0)
            beyond = np.fmax(high - np.fmax(first, last), np.fmin(first, last) - low)
            found = np.flatnonzero((~(beyond <= seen)).any(axis=1))
        return self._nodes[found[0]] if len(found) else None

    def halved(self, fractions: Array) -> Array:
        """Halve parts of all elements until no formula bends on them; the ends of those where one jumps."""
        count = len(fractions) - 1
        element = np.repeat(np.arange(self._elements), count)
        start, end = np.tile(fractions[:-1], self._elements), np.tile(fractions[1:], self._elements)
        bounds = self._bounds(element, start, end)
        while True:
            bends = self._bends(*bounds)
            split = bends & (end - start > _SMALLEST)
            if not split.any():
                break
            if len(start) > _MOST_PARTS:
                raise TrajectoryError(_too_quick(f"after {_MOST_PARTS} parts of elements they still bend"))
            middle = (start[split] + end[split]) / 2
            again = np.tile(element[split], 2)
            halves = np.concatenate([start[split], middle]), np.concatenate([middle, end[split]])
            kept, new = [of[:, ~split] for of in bounds], self._bounds(again, *halves)
            bounds = tuple(np.concatenate(both, axis=1) for both in zip(kept, new, strict=True))
            element = np.concatenate([element[~split], again])
            start, end = (np.concatenate([of[~split], half]) for of, half in zip((start, end), halves, strict=True))
        self._start, self._end = start, end
        return np.union1d(start[bends], end[bends])

    def _bounds(self, element: Indices, start: Array, end: Array) -> tuple[Array, ...]:
        """Lowest and highest value of each node on each part, and how much it changes; shape (nodes, parts)."""
        low, high, changes = (np.zeros((len(self._nodes), len(start))) for _ in range(3))
        leaves = {key: _on_parts(leaf, element, start, end) for key, leaf in self._leaves.items()}
        known = _FormsOfNodes(leaves)
        with np.errstate(all="ignore"):
            for row, node in enumerate(self._nodes):
                try:
                    form = known.of(node)
                except ValueError:  # a function of which no bounds are known
                    continue
                if isinstance(form, TaylorForm):
                    low[row], high[row] = form.value.low, form.value.high
                    bend = form.second.magnitude * (end - start) ** 2 / (8 * _CURVES)
                    width = high[row] - low[row]
                    changes[row] = np.where(np.isfinite(bend), np.fmin(_CHANGE / _CURVES**2 * width, bend), width)
        return low, high, changes

    @staticmethod
    def _bends(low: Array, high: Array, changes: Array) -> BoolArray:
        """Parts on which a formula changes by more than a part of the range that it has over all parts."""
        known = np.isfinite(low) & np.isfinite(high)
        lowest = np.where(known, low, np.inf).min(axis=1, keepdims=True)
        highest = np.where(known, high, -np.inf).max(axis=1, keepdims=True)
        with np.errstate(all="ignore"):
            size = np.fmax(np.abs(lowest), np.abs(highest))
            least = np.nan_to_num(_CHANGE * (highest - lowest) + NEGLIGIBLE * size, nan=0.0, posinf=0.0, neginf=0.0)
            return ~(changes <= least + np.finfo(float).tiny).all(axis=0)


def _on_parts(leaf: Any, element: Indices, start: Array, end: Array) -> Any:
    if not isinstance(leaf, tuple):
        return float(leaf)
    value, first, second = (restrict(order[element], start, end) for order in leaf)
    return taylor_form_of_polynomial((value, first, second))


class _FormsOfNodes(ExpressionEvaluator):
    """Taylor forms of expressions; where a function has a kink or no formula here, its derivatives are unknown."""

    def __init__(self, leaves: Mapping[int, Any]) -> None:
        super().__init__(leaves, _FUNCTIONS)

    def _evaluate(self, node: Any) -> Any:
        if kind_of_node(node.__class__) == POWER:
            base, exponent = (self.of(argument) for argument in node.args)
            if isinstance(exponent, TaylorForm):
                logarithm = base.log() if isinstance(base, TaylorForm) else float(np.log(base))
                return (exponent * logarithm).exp()
        return super()._evaluate(node)


def _without_derivatives(low: Array, high: Array) -> TaylorForm:
    unknown = Interval(np.full_like(low, -np.inf), np.full_like(low, np.inf))
    return TaylorForm(Interval(low, high), unknown, unknown)


def _function(name: str, of_form: Callable[[TaylorForm], TaylorForm]) -> Callable[[Any], Any]:
    of_number = getattr(np, NUMPY_NAMES[name])
    return lambda argument: of_form(argument) if isinstance(argument, TaylorForm) else float(of_number(argument))


def _monotone(name: str) -> Callable[[TaylorForm], TaylorForm]:
    function = getattr(np, NUMPY_NAMES[name])
    return lambda form: _without_derivatives(function(form.value.low), function(form.value.high))


def _absolute(form: TaylorForm) -> TaylorForm:
    crosses = (form.value.low <= 0.0) & (form.value.high >= 0.0)
    low, high = np.abs(form.value.low), np.abs(form.value.high)
    whole = _without_derivatives(np.where(crosses, 0.0, np.minimum(low, high)), np.maximum(low, high))
    second = Interval(np.where(crosses, -np.inf, form.second.low), np.where(crosses, np.inf, form.second.high))
    return TaylorForm(whole.value, whole.first, second)


def _square_root(form: TaylorForm) -> TaylorForm:
    # Rounding may put the lower bound of what cannot be negative below zero.
    return TaylorForm(Interval(np.maximum(form.value.low, 0.0), form.value.high), form.first, form.second).sqrt()


def _hyperbolic_tangent(form: TaylorForm) -> TaylorForm:
    value = _monotone("tanh")(form).value
    slope = Interval.of(1.0) - value.power(2.0)
    return form.compose(value, slope, -(value * slope).times(2.0))


def _compared(surely: Callable[[Any, Any], Any], impossible: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """One where a relation of low and high bounds surely holds, zero where it cannot, and between where neither."""

    def indicator(first: Any, second: Any) -> Any:
        if not isinstance(first, TaylorForm) and not isinstance(second, TaylorForm):
            return float(surely((first, first), (second, second)))
        bounds = [(of.value.low, of.value.high) if isinstance(of, TaylorForm) else (of, of) for of in (first, second)]
        return _without_derivatives(np.where(surely(*bounds), 1.0, 0.0), np.where(impossible(*bounds), 0.0, 1.0))

    return indicator


_NO_MORE = _compared(lambda a, b: a[1] <= b[0], lambda a, b: a[0] > b[1])
_LESS = _compared(lambda a, b: a[1] < b[0], lambda a, b: a[0] >= b[1])
_EQUAL = _compared(lambda a, b: (a[0] == b[1]) & (a[1] == b[0]), lambda a, b: (a[0] > b[1]) | (a[1] < b[0]))


def _choice(condition: Any, first: Any, second: Any) -> Any:
    if not isinstance(condition, TaylorForm):
        return first if condition else second
    count = len(condition.value.low)
    forms = [of if isinstance(of, TaylorForm) else TaylorForm.constant(of, count) for of in (first, second)]
    true, false = condition.value.low > 0.5, condition.value.high < 0.5

    def chosen(order: str, *, jumps: bool) -> Interval:
        a, b = (getattr(form, order) for form in forms)
        low, high = np.fmin(a.low, b.low), np.fmax(a.high, b.high)
        low, high = (np.full_like(low, -np.inf), np.full_like(high, np.inf)) if jumps else (low, high)
        return Interval(
            np.where(true, a.low, np.where(false, b.low, low)), np.where(true, a.high, np.where(false, b.high, high))
        )

    return TaylorForm(chosen("value", jumps=False), chosen("first", jumps=True), chosen("second", jumps=True))


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: _function(name, getattr(TaylorForm, name)) for name in ("sin", "cos", "tan", "exp", "log")},
    **{name: _function(name, _monotone(name)) for name in _MONOTONE},
    "atan": _function("atan", TaylorForm.arctan),
    "acos": _function("acos", lambda form: -_monotone("asin")(form) + np.pi / 2),
    "cosh": _function("cosh", lambda form: _monotone("cosh")(_absolute(form))),
    "abs": _function("abs", _absolute),
    "tanh": _function("tanh", _hyperbolic_tangent),
    "sqrt": _function("sqrt", _square_root),
    "==": _EQUAL,
    "<=": _NO_MORE,
    "<": _LESS,
    "<=<=": lambda a, b, c: _NO_MORE(a, b) * _NO_MORE(b, c),
    "<=<": lambda a, b, c: _NO_MORE(a, b) * _LESS(b, c),
    "<<=": lambda a, b, c: _LESS(a, b) * _NO_MORE(b, c),
    "<<": lambda a, b, c: _LESS(a, b) * _LESS(b, c),
    "choose": _choice,
}


def lowest_value(
    formula: Any, allowed: float, formulas: RuleFormulas, trajectory: Trajectory, indices: Grid
) -> tuple[float, float]:
    """A value of a formula along polynomials that is nearly the lowest, where that is below one that is allowed.

    Parameters
    ----------
    formula : expression
        Of `formulas`.
    allowed : float
        Parts of elements are halved while the formula may be below it, and lower than what was found.
    formulas : RuleFormulas
    trajectory : Trajectory
    indices : Grid
        Its grid in the time indices of the phase.

    Returns
    -------
    float, float
        The value and its time; the one that is allowed where nothing lower was found, or something is not known.
    """
    lowest, time = allowed, 0.0
    boundaries = [np.array(grid.mesh.boundaries) for grid in (indices, trajectory.grid)]
    ends = [np.stack([of[:-1], of[1:]], axis=1) for of in boundaries]
    leaves, read = formulas.leaves(_polynomials(trajectory), ends[0], ends[1]), variables_in_any([formula])
    if not read.keys() <= leaves.keys():
        return lowest, time
    elements = trajectory.grid.mesh.elements
    parts = _Parts([formula], {key: leaves[key] for key in read}, elements)
    element, start = np.divmod(np.arange(elements * SAMPLES), SAMPLES)
    start, width = start / SAMPLES, 1.0 / SAMPLES
    while len(start) and len(start) <= _MOST_PARTS and width > _SMALLEST and np.isfinite(lowest):
        (least,), _, _ = parts._bounds(element, start, start + width)
        width /= 2
        (value,), _, _ = parts._bounds(element, start + width, start + width)
        best = int(np.argmin(np.nan_to_num(value, nan=np.inf, posinf=np.inf)))
        if value[best] < lowest:
            lowest, there = float(value[best]), element[best]
            time = float(boundaries[1][there] + (start[best] + width) * np.diff(boundaries[1])[there])
        again = ~(least >= lowest - _CHANGE * max(0.0, allowed - lowest))
        element, start = np.tile(element[again], 2), np.concatenate([start[again], start[again] + width])
    return lowest, time
