"""Where in its elements a phase has to be looked at, since its rules change there with the time itself.

An integration with steps of its own, and a comparison at a number of instants, see nothing of a gust between them, or
of a vibration with their period. What rules say of the time is known as formulas: bounds on parts of each element tell
where these change, and the parts are halved until every formula hardly bends on each of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.expression_arrays import plain_expressions
from pyrobocop_pyomo.modeling.expression_nodes import CALL, CHOICE, DIVISION, FUNCTION, POWER, RELATION, kind_of_node
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps
from pyrobocop_pyomo.modeling.functions import function_called
from pyrobocop_pyomo.numerics import Array, BoolArray, Grid, Indices
from pyrobocop_pyomo.numerics.bernstein import bernstein_from_samples, derivative_coefficients, restrict
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.numerics.taylor_forms import TaylorForm, taylor_form_of_polynomial
from pyrobocop_pyomo.numerics.taylor_functions import TAYLOR_FUNCTIONS
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
    steps = ExpressionSteps(stated)
    places = changing_places(steps, times)
    if not places:
        return usual
    parts = _parts(formulas, steps, places, trajectory, indices)
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
        steps = ExpressionSteps(stated)
        moving = {id(variable) for variable in formulas.at_instant.values()}
        places = changing_places(steps, moving)
        for call in changing_places(steps, moving | {id(formulas.index), id(formulas.clock)}):
            if steps.steps[call].kind != CALL:
                continue
            cells = getattr(function_called(steps.nodes[call]), "cells", None)
            if cells is None:
                return f"{what} has '{_readable(steps.nodes[call])}', a function of which no bounds are known."
            if _parts(formulas, steps, steps.steps[call].arguments, trajectory, indices).change_by_more_than(cells):
                table = _readable(steps.nodes[call])
                return f"{what} passes several knots of the table '{table}' between two instants."
        least = [0.0] * len(places)
        states = [state for state, name in record.equation_of.items() if name == statement.name]
        for rate, state in zip(steps.outputs, states, strict=False):
            # What changes slowly may add up to something narrow. It counts where it moves a state, at rest as well.
            # Sums and products of signals are polynomials of a low degree, which instants show.
            if changing_places(steps.part([rate]), moving):
                places.append(rate)
                least.append(_CHANGE**2 / part * (1e-3 + float(np.abs(trajectory.states[state]).max())))
        parts = _parts(formulas, steps, places, trajectory, indices, at_one_time=True)
        hidden = parts.hidden(np.array(least)) if places else None
        if hidden is not None:
            return f"{what} has '{_readable(steps.nodes[hidden])}', which the motion may pass between two instants."
    return ""


def _readable(expression: Any) -> str:
    """A formula in the names of the phase."""
    return re.sub(r"declared\[(\w+)\]", r"\1", str(expression))


def _parts(
    formulas: RuleFormulas,
    steps: ExpressionSteps,
    places: Sequence[int],
    trajectory: Trajectory,
    indices: Grid,
    *,
    at_one_time: bool = False,
) -> _Parts:
    """Parts of the elements of a trajectory, for what these steps read along it; or with the time of each start."""
    boundaries = [np.array(grid.mesh.boundaries) for grid in (indices, trajectory.grid)]
    ends = [np.stack([of[:-1], of[:-1] if at_one_time else of[1:]], axis=1) for of in boundaries]
    leaves = formulas.leaves(_polynomials(trajectory), ends[0], ends[1])
    return _Parts(steps, places, leaves, trajectory.grid.mesh.elements)


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


def changing_places(steps: ExpressionSteps, variables: set[int]) -> list[int]:
    """Places of steps that depend on some variables and are no sums or products: what these add up is judged itself."""
    depends, needed = steps.depends_on(lambda leaf: id(leaf.node) in variables), steps.needed
    return [i for i, step in enumerate(steps.steps) if depends[i] and needed[i] and step.kind in _JUDGED]


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
    """Parts of the elements, and how much each formula changes on them; of which no bounds are known none is judged."""

    def __init__(self, steps: ExpressionSteps, places: Sequence[int], leaves: Mapping[int, Any], elements: int) -> None:
        read = {id(leaf.node) for leaf in steps.leaves}
        unknown = steps.depends_on(lambda leaf: id(leaf.node) not in leaves and leaf.node.value is None)
        for place, (kind, what, arguments) in enumerate(steps.steps):
            without_bounds = kind == CALL or (kind == FUNCTION and what not in TAYLOR_FUNCTIONS)
            unknown[place] |= without_bounds or any(unknown[argument] for argument in arguments)
        self._places, self._elements = list(places), elements
        self._known = [row for row, place in enumerate(self._places) if not unknown[place]]
        self._steps = steps.part([self._places[row] for row in self._known])
        self._leaves: dict[int, Any] = {}
        for key, leaf in ((key, leaf) for key, leaf in leaves.items() if key in read):
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
        low, high = (of.reshape(len(self._places), -1, quarters) for of in (low, high))
        at = [start[::quarters], end[quarters - 1 :: quarters]]
        first, last = (self._bounds(element[::quarters], instants, instants)[0] for instants in at)
        return low.min(axis=2), high.max(axis=2), first, last

    def change_by_more_than(self, lengths: Array) -> bool:
        """Whether one of the nodes changes by more than its length between two instants."""
        low, high, _, _ = self._on_samples()
        return not ((high - low).max(axis=1, initial=0.0) <= lengths).all()

    def hidden(self, least: Array) -> int | None:
        """Place of a step that goes beyond its values at two instants by more than is to be seen; None without any.

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
        return self._places[found[0]] if len(found) else None

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
        """Lowest and highest value of each step on each part, and how much it changes; shape (steps, parts)."""
        low, high, changes = (np.zeros((len(self._places), len(start))) for _ in range(3))
        leaves = {key: _on_parts(leaf, element, start, end) for key, leaf in self._leaves.items()}
        with np.errstate(all="ignore"):
            for row, form in zip(self._known, self._steps.evaluate_at(leaves, TAYLOR_FUNCTIONS), strict=True):
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
    leaves, steps = formulas.leaves(_polynomials(trajectory), ends[0], ends[1]), ExpressionSteps([formula])
    if not all(id(leaf.node) in leaves for leaf in steps.leaves if leaf.node.is_variable_type()):
        return lowest, time
    elements = trajectory.grid.mesh.elements
    parts = _Parts(steps, steps.outputs, leaves, elements)
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
