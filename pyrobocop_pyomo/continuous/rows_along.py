"""Rows along a continuous set that a rule says once, for all of its new points.

The rule gets a template of them in place of the point. It may compare it with the points that the set had: new points
lie between these. A rule that has to know more, or reads something else than variables, is called at each point.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from contextlib import AbstractContextManager
from functools import partial
from typing import Any

from pyomo.core.expr import EqualityExpression
from pyomo.core.expr.numvalue import native_numeric_types
from pyomo.core.expr.relational_expr import RelationalExpression
from pyomo.core.expr.template_expr import GetItemExpression
from pyomo.dae import DerivativeVar

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.failures import failures_as
from pyrobocop_pyomo.modeling.rows_by_rule import RepeatedSum, RowRule
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.templates.formula_rows import FormulaRows, by_label
from pyrobocop_pyomo.templates.slots import Place, Slot
from pyrobocop_pyomo.templates.template import PointBetween, formulas_of
from pyrobocop_pyomo.transcription import collocation_row, collocation_sums, place_of

from .structure import Axis, rule_of


class RowsAlong(FormulaRows):
    """The rows of a constraint at new points of a continuous set; their labels are its other indices.

    Parameters
    ----------
    axis : Axis
    formulas : mapping of label to formulas
        Of the row; of one that gives a derivative explicitly, of the derivative and its right-hand side.
    rows : mapping of label to row
        At one point.
    """

    def __init__(self, axis: Axis, formulas: Mapping[Hashable, Any], rows: Mapping[Hashable, Any]) -> None:
        super().__init__(rows)
        self._axis, self._formulas = axis, formulas

    def parts(self, index: Any) -> tuple[float, Hashable]:
        """The point, and the other indices."""
        return self._axis.time(index), self._axis.others(index)

    def slots(self, block: Any) -> Mapping[Hashable, list[Slot]]:
        """By what the rule says for all new points."""
        return {label: formulas.slots for label, formulas in self._formulas.items()}

    def __call__(self, block: Any, index: Any) -> Any:
        """The row of an index."""
        time, label = self.parts(index)
        return _row(self._formulas[label].on_model(Place(block, time)))

    def right_hand_side(self, time: float, label: Hashable) -> Any:
        """What a row that gives a derivative explicitly says of it, at any point."""
        return self._formulas[label].on_model(Place(None, time))[1]

    def is_right_hand_side(self, side: Any, time: float, label: Hashable) -> bool:
        """Whether an expression is what they say of the derivative at a point."""
        return bool(self._formulas[label].says(self.right_hand_side(time, label), side))

    def slots_of_sides(self, label: Hashable) -> Mapping[Hashable, list[Slot]]:
        """What a row gives explicitly, if it does, and what it reads otherwise."""
        found: Mapping[Hashable, list[Slot]] = self._formulas[label].slots_by(
            lambda said: dict(enumerate(said)) if said.__class__ is list else {0: 0.0, 1: said}
        )
        return found

    def given(
        self, block: Any, rows: Iterable[Any], derivatives: Mapping[int, Any]
    ) -> tuple[dict[int, tuple[Any, Any]], set[int]]:
        """As `row_variables` has it; right-hand sides are None: they are made when they are read."""
        given: dict[int, tuple[Any, Any]] = {}
        held: set[int] = set()
        rows_at = {row.index(): row for row in rows}
        for label, indices in by_label(rows_at, self._axis.others).items():
            times, slots = [self._axis.time(index) for index in indices], self.slots_of_sides(label)
            sides = [slot.at_all(block, times) for slot in slots[0]]
            for index, *derivative in zip(indices, *sides, strict=True):
                given |= {id(data): (rows_at[index], None) for data in derivative if id(data) in derivatives}
            held.update(id(data) for alike in sides for data in alike if id(data) not in derivatives)
            held.update(id(data) for slot in slots[1] for data in slot.at_all(block, times))
        return given, held


def rows_along(component: Any, axis: Axis, points: tuple[float, ...], new: list[Any]) -> RowsAlong | None:
    """What the rule of a constraint says of the new points of a set; None where it has to be called at each.

    Parameters
    ----------
    component : Constraint
    axis : Axis
    points : tuple of float
        The first ones.
    new : list of index
    """
    rule, block, point = rule_of(component), component.parent_block(), PointBetween(points)
    formulas: dict[Hashable, Any] = {}
    rows: dict[Hashable, Any] = {}
    for index in new:
        label = axis.others(index)
        if label in formulas:
            continue

        def at(home: Any, time: Any, label: Hashable = label) -> Any:
            return rule(home, axis.join(label, time))

        said = formulas_of(at, block, time=point, read=_sides)
        if said is None or not said.reads_variables_alone:
            return None
        with failures_at_new_point(component, index):
            stated = rule(block, index)
        here = _row(said.on_model(Place(block, axis.time(index))))
        if not isinstance(stated, RelationalExpression) or not said.says(here, stated):
            return None
        formulas[label], rows[label] = said, stated
    return RowsAlong(axis, formulas, rows)


def failures_at_new_point(component: Any, index: Any) -> AbstractContextManager[None]:
    """Context in which the failure of a rule is a `ModelError` that names its component."""
    return failures_as(ModelError, f"'{component.name}': its rule failed at the new point {index}")


def _sides(row: Any) -> Any:
    """A derivative and its right-hand side where a template says them in this order; any other one is itself."""
    if not isinstance(row, EqualityExpression):
        return row
    of_derivatives = [_is_derivative(side) for side in row.args]
    if True not in of_derivatives:
        return row
    if not of_derivatives[0] or row.args[1].__class__ in native_numeric_types:
        raise TypeError("such an equation is read at each point")
    return list(row.args)


def _is_derivative(side: Any) -> bool:
    return isinstance(side, GetItemExpression) and isinstance(side.arg(0), DerivativeVar)


def _row(said: Any) -> Any:
    return said[0] == said[1] if said.__class__ is list else said


class ExplicitRows(RowRule):
    """Collocation rows of a derivative that `RowsAlong` give explicitly.

    Parameters
    ----------
    state : Var
    grid : Grid
    axis : Axis
        Of the derivative.
    sides : mapping of other indices of the derivative to (RowsAlong, label)
    """

    def __init__(self, state: Any, grid: Grid, axis: Axis, sides: Mapping[Any, tuple[RowsAlong, Hashable]]) -> None:
        self._state, self._grid, self._axis, self._sides = state, grid, axis, sides

    def __call__(self, block: Any, index: Any) -> Any:
        """The row at a collocation point."""
        others, (element, row) = self._axis.others(index), place_of(self._grid, self._axis.time(index))
        rule, label = self._sides[others]
        states = {time: self._state[self._axis.join(others, time)] for time in self._grid.node_times[element]}
        stages = zip(self._grid.stage_times[element], self._grid.scheme.F[row].tolist(), strict=True)
        rates = {time: rule.right_hand_side(time, label) for time, weight in stages if weight != 0.0}
        return collocation_row(states, rates, self._grid, element, row, self._grid.mesh.widths[element])

    def sums(self, block: Any, indices: list[Any]) -> list[RepeatedSum]:
        """Those of each line."""
        found = []
        for others, positions in by_label(range(len(indices)), lambda i: self._axis.others(indices[i])).items():
            times = [self._axis.time(indices[position]) for position in positions]
            state = {time: self._state[self._axis.join(others, time)] for time in self._grid.times}
            rates = partial(self._right_hand_sides, *self._sides[others])
            for repeated in collocation_sums(self._grid, state, times, rates, self._grid.mesh.widths.tolist()):
                found.append(repeated._replace(rows=[positions[row] for row in repeated.rows]))
        return found

    @staticmethod
    def _right_hand_sides(rule: RowsAlong, label: Hashable, times: list[float], elements: list[int]) -> Any:
        variables = [slot.at_all(None, times) for slot in rule.slots_of_sides(label)[1]]
        return variables, lambda place: rule.right_hand_side(times[place], label)
