"""What rules do between the points of the mesh, along the polynomials of a trajectory.

Bounds and path constraints are rows at the points: evaluated at many instants they tell how far they are passed between
them. A number of instants shows nothing of a gust between them, or of a vibration with their period. There rules are
bounded on parts of each element, and the parts are halved until every formula hardly bends on each of them.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.expression_nodes import CALL, CHOICE, DIVISION, FUNCTION, POWER, RELATION, kind_of_node
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps, Leaf
from pyrobocop_pyomo.modeling.functions import function_called
from pyrobocop_pyomo.modeling.row_violations import sides_of_row
from pyrobocop_pyomo.modeling.shared_nodes import expressions_returned, variables_in_any
from pyrobocop_pyomo.numerics import Array, BoolArray, Indices
from pyrobocop_pyomo.numerics.interval_arithmetic import TAYLOR_FUNCTIONS, TaylorForm, taylor_form_of_polynomial
from pyrobocop_pyomo.numerics.polynomials import (
    bernstein_from_samples,
    bernstein_matrix,
    derivative_coefficients,
    differentiation_matrix,
    restrict,
)
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.trajectories import Trajectory

from .declarations import UNBOUNDED, Control, State, in_infinities
from .element_instants import ElementInstants
from .nodes import StageNodes, StateNodes
from .record import PhaseRecord, Statement
from .rule_formulas import RuleFormulas, shown_by_name

# Instants per element at which polynomials are evaluated, and the excess worth a sentence, in sizes of the signal.
_INSTANTS, WORTH_A_SENTENCE = 24, 1e-3
# Parts of each element at whose ends motions are compared in any case.
SAMPLES = 16
# On a part a formula changes by such a share of its whole range, or its chord is a tenth of that away from it.
_CHANGE = 0.1
# Where a formula jumps parts are halved down to this length, relative to an element.
_SMALLEST = 2.0**-40
# Instants in an element, and parts of all elements together, at most.
_MOST_INSTANTS, _MOST_PARTS = 2000, 200_000

_JUDGED = {FUNCTION, POWER, DIVISION, CHOICE, RELATION, CALL}


# What is known of what has no value.
_UNKNOWN = TaylorForm.constant(np.nan, 1)


# --------------------------------------------------------------------------------------------------- at many instants


class BoundPassed(NamedTuple):
    """By how much a polynomial passes a bound at most, when, which bound that is, and of what size of which signal.

    `is_control` is true of what controls or algebraics can meet; `of_elements` has the excess in each element.
    """

    excess: float
    time: float
    bound: float
    size: float
    is_control: bool
    of_elements: Array


def bounds_passed(formulas: RuleFormulas, trajectory: Trajectory) -> dict[str, BoundPassed]:
    """States and controls whose polynomials pass their declared bounds between the points of the mesh; and rates.

    What moves by step maps is left out. At the points themselves bounds are rows of the model: what is violated there
    as well counts between them only for what is more.

    Parameters
    ----------
    formulas : RuleFormulas
    trajectory : Trajectory

    Returns
    -------
    dict of name to BoundPassed
        Sampled at 24 instants per element, so that an excess is found to about one percent of itself.
    """
    record: PhaseRecord = formulas.record
    instants = _between_and_at_points(formulas, trajectory)
    scheme, widths = trajectory.grid.scheme, np.array(trajectory.grid.mesh.widths)
    found: dict[str, BoundPassed] = {}
    for name in [*record.names(State), *record.names(Control)]:
        declaration: Any = record.declarations[name]
        is_control = name in trajectory.signals
        if declaration.bounds != UNBOUNDED and name not in record.discrete_states:
            sides = [(at.values[name], *at.bounds(name)) for at in instants]
            found |= _passed(name, instants[0].clock, sides, is_control)
        rates = declaration.rate_bounds if is_control else declaration.derivative_bounds
        # From knot to knot a rate is what its rows say.
        if rates is not None and isinstance(record.nodes(name), (StageNodes, StateNodes)):
            lower, upper = in_infinities(rates)
            slopes = [at.slopes.get(name) for at in instants]
            if is_control:
                at_stages = trajectory.element_signals(name).T / widths
                inside, at_points = (differentiation_matrix(scheme.c, at.fractions) @ at_stages for at in instants)
                slopes = [inside, np.clip(at_points, lower, upper)]  # at the points its rows are about differences
            found |= _passed(f"rate of {name}", instants[0].clock, [(of, lower, upper) for of in slopes], True)
    return found


def rows_passed(formulas: RuleFormulas, trajectory: Trajectory, statement: Statement) -> dict[str, BoundPassed]:
    """The inequalities of a path constraint that are passed between the points, as `bounds_passed`.

    Parameters
    ----------
    formulas : RuleFormulas
    trajectory : Trajectory
    statement : Statement

    Raises
    ------
    TrajectoryError
        When the rule gives no formula that holds at all times, or one without a value at some instant.
    """
    rows = sides_stated(formulas, statement)
    signals = {id(formulas.at_instant[name]) for name in trajectory.signals}
    instants = _between_and_at_points(formulas, trajectory)
    found: dict[str, BoundPassed] = {}
    with np.errstate(all="ignore"):
        for label, row in rows.items():
            sides = [at.evaluated(row, at.values) for at in instants]
            if any(np.isnan(side).any() for at in sides for side in at):
                raise TrajectoryError("It has no value at some instant between the points.")
            if not np.array_equal(sides[0][1], sides[0][2]):
                name = statement.name if label is None else f"{statement.name}[{label}]"
                met = not signals.isdisjoint(variables_in_any(row))
                found |= _passed(name, instants[0].clock, sides, met)
    return found


def _between_and_at_points(formulas: RuleFormulas, trajectory: Trajectory) -> list[ElementInstants]:
    # Dense at the ends, where a polynomial through stages alone goes farthest.
    inside = (1.0 - np.cos(np.pi * (np.arange(_INSTANTS) + 0.5) / _INSTANTS)) / 2.0
    return [ElementInstants(formulas, trajectory, at) for at in (inside, trajectory.grid.scheme.c)]


def _passed(name: str, times: Array, sides: Any, is_control: bool) -> dict[str, BoundPassed]:
    """What passes a bound: `sides` are the body and both bounds, between the points and at them."""
    between, points = sides
    size = max(1e-3, float(np.abs(points[0]).max(initial=0.0)))
    found: dict[str, BoundPassed] = {}
    for side, sign in ((1, -1.0), (2, 1.0)):
        there = max(0.0, float((sign * (points[0] - points[side])).max(initial=0.0)))
        beyond = sign * (between[0] - between[side]) - there
        worst = int(beyond.argmax())
        excess = float(beyond.flat[worst])
        if excess > max(1e-9 * size, found[name].excess if found else 0.0):
            bound = float(np.broadcast_to(between[side], times.shape).flat[worst])
            of_elements = np.maximum(beyond, 0.0).max(axis=0)
            found[name] = BoundPassed(excess, float(times.flat[worst]), bound, size, is_control, of_elements)
    return found


def sentence_on_bounds(passed: Mapping[str, BoundPassed]) -> str:
    """Which bounds are passed by more than a thousandth of the signal's size, and what to do; empty where none is."""
    worth = {name: one for name, one in passed.items() if one.excess > WORTH_A_SENTENCE * one.size}
    if not worth:
        return ""
    ordered = sorted(worth, key=lambda name: -worth[name].excess / worth[name].size)
    shown = [
        f"'{name}' passes its bound {worth[name].bound:g} by {worth[name].excess:.2g} at t = {worth[name].time:.3g}"
        for name in ordered[:3]
    ]
    more = f" (and {len(ordered) - 3} more)" if len(ordered) > 3 else ""
    # Where a control jumps, its polynomial passes the bound on any mesh.
    some_states = not all(one.is_control for one in worth.values())
    remedies = [*(["more elements"] if some_states else []), "a bound with a margin"]
    if any(one.is_control for one in worth.values()):
        remedies.append("parametrization='piecewise_constant' for a control")
    return f"Between the points of the mesh {', '.join(shown)}{more}. What helps: {', or '.join(remedies)}."


def sides_stated(formulas: RuleFormulas, statement: Statement) -> dict[Hashable, tuple[Any, Any, Any]]:
    """Body and bounds of the rows that a statement makes at any time, by label.

    Raises
    ------
    TrajectoryError
        When it gives no formulas.
    """
    return formulas.formulas_of(
        statement, lambda result: {label: sides_of_row(row) for label, row in statement.rows(result).items()}
    )


# ---------------------------------------------------------------------------------------------- by bounds, in between


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """One polynomial on each interval.

    Attributes
    ----------
    coefficients : array, shape (intervals, degree + 1)
        Of the Bernstein polynomials of the local fraction.
    """

    coefficients: Array

    @cached_property
    def _orders(self) -> tuple[Array, Array, Array]:
        """Coefficients of the polynomials and of their first two derivatives."""
        slope = derivative_coefficients(self.coefficients)
        return self.coefficients, slope, derivative_coefficients(slope)

    def values(self, interval: Indices, fraction: Array) -> Array:
        """Values at local fractions of intervals, shape ``(m,)``."""
        basis = bernstein_matrix(self.coefficients.shape[1] - 1, fraction)
        return np.asarray((basis * self.coefficients[interval]).sum(axis=1), dtype=np.float64)

    def taylor_form(self, interval: Indices, start: Array, end: Array) -> TaylorForm:
        """Bounds on subintervals; derivatives are with respect to the local fraction."""
        value, first, second = (restrict(order[interval], start, end) for order in self._orders)
        return taylor_form_of_polynomial((value, first, second))


def instants_to_look_at(formulas: RuleFormulas, trajectory: Trajectory, statements: Iterable[Statement]) -> Array:
    """Local fractions of elements between which the rules hardly change with the time, the same for all elements.

    Parameters
    ----------
    formulas : RuleFormulas
    trajectory : Trajectory
        What rules read beside the time is that of its polynomials.
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
    found = np.linspace(0.0, 1.0, SAMPLES + 1)
    for statement in statements:
        if statement not in formulas.instants:
            formulas.instants[statement] = _instants(formulas, trajectory, statement)
        found = np.union1d(found, formulas.instants[statement])
    if len(found) > _MOST_INSTANTS:
        raise TrajectoryError(_too_quick(f"{len(found)} instants of each element would have to be looked at"))
    return found


def _instants(formulas: RuleFormulas, trajectory: Trajectory, statement: Statement) -> Array:
    """Those of one rule."""
    usual, times = np.linspace(0.0, 1.0, SAMPLES + 1), {id(formulas.index), id(formulas.clock)}
    stated = stated_formulas(formulas, statement)
    if not times & variables_in_any(stated).keys():
        return usual
    steps = ExpressionSteps(stated)
    places = changing_places(steps, times)
    if not places:
        return usual
    parts = _Parts(formulas, steps, places, trajectory)
    found, jumps = parts.halved(usual)
    if len(jumps):  # parts that were halved on the way to a jump are not needed beside it
        found, _ = parts.halved(np.union1d(usual, jumps))
    return found


def unseen_on_the_way(block: Any, trajectory: Trajectory, statements: Iterable[Statement]) -> str:
    """Which rule may do something along the way of a trajectory that ``SAMPLES`` instants of an element do not show.

    Quick changes with the time are found by `instants_to_look_at`. This is about places: a jet that is passed between
    two instants shows in the bounds of its formula only. A function in Python has no bounds; of a table of two inputs
    the knots are known.

    Parameters
    ----------
    block : PhaseBlock
    trajectory : Trajectory
    statements : iterable of Statement

    Returns
    -------
    str
        The first one, in words; empty where there is none.
    """
    part = float(trajectory.grid.mesh.widths.max()) / SAMPLES
    for statement in statements:
        what = f"{statement.kind} '{statement.name}' of phase '{block.name}'"
        if not statement.rule.is_template(block):
            return f"{what} has to know the time as a number, and may do anything between two instants."
        formulas = RuleFormulas(block, trajectory.grid)
        stated = stated_formulas(formulas, statement)
        rates = formulas.by_state(statement) if stated and statement.kind == "ode" else {}
        steps = ExpressionSteps(list(rates.values()) or stated)
        moving = {id(variable) for variable in formulas.at_instant.values()}
        places = changing_places(steps, moving)
        for call in changing_places(steps, moving | {id(formulas.index), id(formulas.clock)}):
            if steps.steps[call].kind != CALL:
                continue
            function = function_called(steps.nodes[call])
            cells = getattr(function, "cells", None)
            if len(steps.steps[call].arguments) == 1 and hasattr(function, "taylor_form"):
                continue  # its bounds are known
            if cells is None:
                return f"{what} has {shown_by_name(steps.nodes[call])}, a function of which no bounds are known."
            if _Parts(formulas, steps, steps.steps[call].arguments, trajectory).change_by_more_than(cells):
                table = shown_by_name(steps.nodes[call])
                return f"{what} passes several knots of the table {table} between two instants."
        least = [0.0] * len(places)
        for rate, state in zip(steps.outputs, rates, strict=False):
            # What changes slowly may add up to something narrow. It counts where it moves a state, at rest as well.
            # Sums and products of signals are polynomials of a low degree, which instants show.
            if changing_places(steps.part([rate]), moving):
                places.append(rate)
                least.append(_CHANGE**2 / part * (1e-3 + float(np.abs(trajectory.states[state]).max())))
        parts = _Parts(formulas, steps, places, trajectory, at_one_time=True)
        hidden = parts.hidden(np.array(least)) if places else None
        if hidden is not None:
            return f"{what} has {shown_by_name(steps.nodes[hidden])}, which the motion may pass between two instants."
    return ""


def _too_quick(why: str) -> str:
    return (
        f"its rules change so quickly with the time that the motion between the points is not known: {why}. Take "
        "more and shorter elements, or state what the quick part does on average."
    )


def stated_formulas(formulas: RuleFormulas, statement: Statement) -> list[Any]:
    """What a rule gives at any time, side by side of its rows; nothing where it gives no formulas."""
    try:
        stated = expressions_returned(formulas.formulas_of(statement))
    except TrajectoryError:
        return []
    return [side for each in stated for side in (each.args if kind_of_node(each.__class__) == RELATION else [each])]


def changing_places(steps: ExpressionSteps, variables: set[int]) -> list[int]:
    """Places of steps that depend on some variables and are no sums or products: what these add up is judged itself."""
    depends, needed = steps.depends_on(lambda leaf: id(leaf.node) in variables), steps.needed
    return [i for i, step in enumerate(steps.steps) if depends[i] and needed[i] and step.kind in _JUDGED]


def _polynomials(trajectory: Trajectory) -> dict[str, Any]:
    """What moves, and the numbers of what does not, by name."""
    points, to_coefficients = bernstein_from_samples(trajectory.grid.scheme.stages + 1)
    values = trajectory.element_polynomials(points)
    moving = {name: PiecewisePolynomial(of @ to_coefficients.T) for name, of in values.items()}
    return moving | dict(trajectory.parameters)


class _Parts:
    """Bounds of formulas along a trajectory, on parts of its elements; of which no bounds are known none is judged.

    Parameters
    ----------
    formulas : RuleFormulas
    steps : ExpressionSteps
    places : sequence of int
        Of the steps that are judged.
    trajectory : Trajectory
    at_one_time : bool
        Whether the time is that of the start of each element.
    """

    def __init__(
        self,
        formulas: RuleFormulas,
        steps: ExpressionSteps,
        places: Sequence[int],
        trajectory: Trajectory,
        *,
        at_one_time: bool = False,
    ) -> None:
        self._places, self._steps, self._elements = places, steps.part(places), trajectory.grid.mesh.elements
        boundaries = [np.array(grid.mesh.boundaries) for grid in (formulas.indices, trajectory.grid)]
        ends = [np.stack([of[:-1], of[:-1] if at_one_time else of[1:]], axis=1) for of in boundaries]
        index, clock = map(PiecewisePolynomial, ends)
        self._leaves = formulas.leaves(_polynomials(trajectory), index, clock)

    def _on_samples(self) -> tuple[Array, ...]:
        """Lowest and highest value of each node on each of ``SAMPLES`` parts of all elements, and those at its ends."""
        quarters = 4  # bounds of short parts are close
        edges = np.linspace(0.0, 1.0, quarters * SAMPLES + 1)
        element = np.repeat(np.arange(self._elements), quarters * SAMPLES)
        start, end = (np.tile(of, self._elements) for of in (edges[:-1], edges[1:]))
        low, high, _ = self.bounds(element, start, end)
        low, high = (of.reshape(len(self._places), -1, quarters) for of in (low, high))
        at = [start[::quarters], end[quarters - 1 :: quarters]]
        first, last = (self.bounds(element[::quarters], instants, instants)[0] for instants in at)
        return low.min(axis=2), high.max(axis=2), first, last

    def change_by_more_than(self, lengths: Array) -> bool:
        """Whether one of the nodes changes by more than its length between two instants."""
        low, high, _, _ = self._on_samples()
        return not ((high - low).max(axis=1, initial=0.0) <= lengths).all()

    def hidden(self, least: Array) -> int | None:
        """Place of a step that leaves the range of its values at two instants, between them, by more than `least`.

        None where there is none. Between the two instants is a third one, so that a narrow peak counts also where an
        instant happens to meet it.
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
        return self._places[found[0]] if len(found) else None

    def halved(self, fractions: Array) -> tuple[Array, Array]:
        """Ends of the parts of any element on which no formula bends, by halving; and of those where one jumps."""
        count = len(fractions) - 1
        element = np.repeat(np.arange(self._elements), count)
        start, end = np.tile(fractions[:-1], self._elements), np.tile(fractions[1:], self._elements)
        bounds = self.bounds(element, start, end)
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
            kept, new = [of[:, ~split] for of in bounds], self.bounds(again, *halves)
            bounds = tuple(np.concatenate(both, axis=1) for both in zip(kept, new, strict=True))
            element = np.concatenate([element[~split], again])
            start, end = (np.concatenate([of[~split], half]) for of, half in zip((start, end), halves, strict=True))
        return np.union1d(start, end), np.union1d(start[bends], end[bends])

    def bounds(self, element: Indices, start: Array, end: Array) -> tuple[Array, ...]:
        """Lowest and highest value of each step on each part, and how much it changes; shape (steps, parts)."""
        low, high, changes = (np.zeros((len(self._places), len(start))) for _ in range(3))
        known: dict[int, Any] = {}

        def read(leaf: Leaf) -> Any:
            key = id(leaf.node)
            if key not in known:
                found = self._leaves[key] if key in self._leaves else value(leaf.node, exception=False)
                is_moving = isinstance(found, PiecewisePolynomial)
                known[key] = (
                    found.taylor_form(element, start, end) if is_moving else _UNKNOWN if found is None else found
                )
            return known[key]

        with np.errstate(all="ignore"):
            for row, form in enumerate(self._steps.evaluate(read, TAYLOR_FUNCTIONS)):
                if isinstance(form, TaylorForm) and not np.isnan(form.value.low).all():
                    low[row], high[row] = form.value.low, form.value.high
                    bend = form.second.magnitude * (end - start) ** 2 / (8 * _CHANGE)
                    width = high[row] - low[row]
                    changes[row] = np.where(np.isfinite(bend), np.fmin(width / _CHANGE, bend), width)
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


def lowest_value(formula: Any, allowed: float, formulas: RuleFormulas, trajectory: Trajectory) -> tuple[float, float]:
    """A value of a formula along polynomials that is nearly the lowest, where that is below one that is allowed.

    Parameters
    ----------
    formula : expression
        Of `formulas`.
    allowed : float
        Parts of elements are halved while the formula may be below it, and lower than what was found.
    formulas : RuleFormulas
    trajectory : Trajectory

    Returns
    -------
    float, float
        The value and its time; the one that is allowed where nothing lower was found, or something is not known.
    """
    lowest, time = allowed, 0.0
    boundaries = np.array(trajectory.grid.mesh.boundaries)
    steps = ExpressionSteps([formula])
    parts = _Parts(formulas, steps, steps.outputs, trajectory)
    element, start = np.divmod(np.arange(trajectory.grid.mesh.elements * SAMPLES), SAMPLES)
    start, width = start / SAMPLES, 1.0 / SAMPLES
    while len(start) and len(start) <= _MOST_PARTS and width > _SMALLEST and np.isfinite(lowest):
        (least,), _, _ = parts.bounds(element, start, start + width)
        width /= 2
        (value,), _, _ = parts.bounds(element, start + width, start + width)
        best = int(np.argmin(np.nan_to_num(value, nan=np.inf, posinf=np.inf)))
        if value[best] < lowest:
            lowest, there = float(value[best]), element[best]
            time = float(boundaries[there] + (start[best] + width) * np.diff(boundaries)[there])
        again = ~(least >= lowest - _CHANGE * max(0.0, allowed - lowest))
        element, start = np.tile(element[again], 2), np.concatenate([start[again], start[again] + width])
    return lowest, time
