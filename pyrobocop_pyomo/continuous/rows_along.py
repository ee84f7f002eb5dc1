"""Rows along a continuous set that a rule says once, for all of its new points.

The rule gets a template of them in place of the point. It may compare it with the points that the set had: new points
lie between these. A rule that has to know more, or reads something else than variables, is called at each point.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from contextlib import AbstractContextManager
from typing import Any

from pyomo.core.expr.relational_expr import RelationalExpression

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.failures import failures_as
from pyrobocop_pyomo.templates.formula_rows import FormulaRows
from pyrobocop_pyomo.templates.slots import Place, Slot
from pyrobocop_pyomo.templates.template import PointBetween, formulas_of

from .structure import Axis, rule_of


class RowsAlong(FormulaRows):
    """The rows of a constraint at new points of a continuous set; their labels are its other indices.

    Parameters
    ----------
    axis : Axis
    formulas : mapping of label to formulas
        Of the row.
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
        return self.at(*self.parts(index))

    def at(self, time: float, label: Hashable) -> Any:
        """What the rule says at any point."""
        return self._formulas[label].on_model(Place(None, time))


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

        said = formulas_of(at, block, time=point)
        if said is None or not said.reads_variables_alone:
            return None
        with failures_at_new_point(component, index):
            stated = rule(block, index)
        here = said.on_model(Place(block, axis.time(index)))
        if not isinstance(stated, RelationalExpression) or not said.says(here, stated):
            return None
        formulas[label], rows[label] = said, stated
    return RowsAlong(axis, formulas, rows)


def failures_at_new_point(component: Any, index: Any) -> AbstractContextManager[None]:
    """Context in which the failure of a rule is a `ModelError` that names its component."""
    return failures_as(ModelError, f"'{component.name}': its rule failed at the new point {index}")
