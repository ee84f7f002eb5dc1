"""Components at the new points of a continuous set: their data, and what variables inherit from the old points.

Bounds and domains of the declaration hold at every point; Pyomo sees to that. What was set afterwards, by
``x.setub(3)`` or ``u.fix(0)``, exists at the first points only, and has to be told from a boundary condition. The
rules, for each variable with its other indices:

* changed at every point and equal: it was meant for all points;
* changed at some points only: a condition at these points;
* changed at every point and different: ambiguous, refused;
* fixed at every point: a control or an algebraic is fixed everywhere, if at one value or at its declared ones; a state
  is not, since fixing it at both ends is how boundary conditions are stated.

The rule of a constraint says its rows once, for all new points: it gets a template of them in place of the point, which
it may compare with the points that the set had, since new points lie between these. A rule that has to know more, or
reads something else than variables, is called at each point.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.param import Param
from pyomo.core.base.piecewise import Piecewise
from pyomo.core.base.set import Set, SetOf
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import NumericValue, native_numeric_types, value
from pyomo.core.expr.relational_expr import RelationalExpression
from pyomo.dae import DerivativeVar, Integral
from pyomo.mpec import Complementarity as MpecComplementarity

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.failures import failures_as
from pyrobocop_pyomo.modeling.pyomo_internals import parts_of, stated_rule
from pyrobocop_pyomo.modeling.rows_by_rule import add_rows_by_rule
from pyrobocop_pyomo.modeling.variable_values import within_bounds
from pyrobocop_pyomo.templates.formula_rows import FormulaRows
from pyrobocop_pyomo.templates.slots import Place, Slot
from pyrobocop_pyomo.templates.template import PointBetween, formulas_of

from .structure import PAIRS, Axis, Spot, axis_on, rule_of

# In this order: a rule uses components that come before its own. Blocks and expressions that are used earlier are made
# on demand by Pyomo.
ORDER = (Param, Var, DerivativeVar, Block, Expression, Constraint, Complementarity, MpecComplementarity)
LEFT_ALONE = (Integral, Set, SetOf, Suffix)
ATTRIBUTE_NAMES = {"lower": "lower bounds", "upper": "upper bounds", "domain": "domains"}


def refuse_what_cannot_grow(spots: list[Spot], domain: Any) -> None:
    """Raise a `ModelError` that names a component which has no way to get new points."""
    for spot in spots:
        component = spot.component
        if component.ctype in LEFT_ALONE or component.is_reference() or axis_on(component, domain) is None:
            continue
        along = component.get_continuousset_list() if isinstance(component, DerivativeVar) else [domain]
        if any(one is not along[0] for one in along) and any(one is domain for one in along):
            raise ModelError(
                f"'{component.name}': is a derivative along {' and '.join(sorted({one.name for one in along}))} "
                "together. Discretise all of these by dae.finite_difference or dae.collocation."
            )
        if component.ctype not in ORDER:
            raise ModelError(
                f"'{component.name}': a {component.ctype.__name__} indexed by '{domain.name}' cannot be discretised. "
                "Build it after the transformation."
            )
        if component.ctype in (Constraint, *PAIRS) and len(parts_of(component)) > 0 and rule_of(component) is None:
            raise ModelError(
                f"'{component.name}': is indexed by '{domain.name}' but has no function as its rule, so that its rows "
                "at new points are unknown. Give it rule=..., or build it after the transformation."
            )


def expand(spots: list[Spot], domain: Any, points: tuple[float, ...]) -> None:
    """Add what is missing at points of a continuous set, which had some before.

    Raises
    ------
    ModelError
        When a rule fails at a new point.
    """
    for ctype in ORDER:
        for spot in spots:
            component = spot.component
            if component.ctype is not ctype or component.is_reference():
                continue
            axis = axis_on(component, domain)
            # An empty component with a rule may get rows at new points.
            if axis is None or (ctype in (Constraint, *PAIRS) and rule_of(component) is None):
                continue
            known = {axis.others(index) for index in component}
            all_inactive = len(parts_of(component)) > 0 and not any(
                getattr(data, "active", True) for data in parts_of(component).values()
            )
            new = [index for index in component.index_set() if index not in parts_of(component)]
            between = [index for index in new if axis.time(index) not in points] if ctype is Constraint else []
            said = rows_along(component, axis, points, between) if between else None
            if said is not None:
                add_rows_by_rule(component, said, between)
            for index in new:
                if index in parts_of(component) or (ctype is Var and axis.others(index) not in known):
                    continue
                with failures_at_new_point(component, index):
                    _make(component, index)
            for index in new if all_inactive else ():
                if index in parts_of(component):
                    parts_of(component)[index].deactivate()


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


def _make(component: Any, index: Any) -> None:
    """Make what the declaration says at a point, as Pyomo does; it may say nothing there."""
    ctype = component.ctype
    if isinstance(component, Piecewise):
        component.add(index)
    elif ctype is Param:
        _parameter(component, index)
    elif ctype in (Var, DerivativeVar):
        _variable(component, index)
    elif ctype not in (Constraint, Expression):
        component._getitem_when_not_present(index)
    elif (rule := stated_rule(component)) is not None:
        said = rule(component.parent_block(), index)
        if said is not ctype.Skip:
            component._setitem_when_not_present(index, said)


def _parameter(component: Any, index: Any) -> None:
    """The initial value where a function or a number gives it; a default needs no entry."""
    rule = rule_of(component)
    if rule is None:
        return
    value = rule(component.parent_block(), index)
    if value is Param.NoValue:
        return
    # An immutable parameter takes values while it is under construction only.
    component._constructed = None
    try:
        component._setitem_when_not_present(index, value)
    finally:
        component._constructed = True


def _variable(component: Any, index: Any) -> None:
    """As Pyomo makes it; a mapping of initial values that lacks the new point says nothing here."""
    rule = component._rule_init
    if rule is not None and rule.contains_indices() and index not in set(rule.indices()):
        component._rule_init = None
    try:
        component._getitem_when_not_present(index)
    finally:
        component._rule_init = rule


@dataclass
class Family:
    """One variable along a continuous set.

    Attributes
    ----------
    is_state : bool
        Whether it has a derivative with respect to the set.
    is_in_blocks : bool
        Whether it is in blocks along the set: their rule says at the first new point what was declared.
    points : set of float
        The collocation points.
    old, new : list of (time, variable)
    """

    is_state: bool
    is_in_blocks: bool
    points: frozenset[float]
    old: list[tuple[float, Any]]
    new: list[tuple[float, Any]]

    def inherit(self, domain: Any) -> None:
        """Give the new points what the old ones have.

        Raises
        ------
        ModelError
            When the old points disagree.
        """
        if not self.old or not self.new:
            return
        declared = [self.new[0][1] if self.is_in_blocks else _as_declared(data) for _, data in self.old]
        for attribute in ATTRIBUTE_NAMES:
            self._inherit(attribute, declared, domain)
        initial = [data.value for data in declared]
        self._interpolate_values(initial)
        if not self.is_state:
            self._inherit_fixing(initial, domain)

    def _inherit(self, attribute: str, declared: list[Any], domain: Any) -> None:
        given = [getattr(data, attribute) for _, data in self.old]
        changed = [not _same(bound, getattr(data, attribute)) for bound, data in zip(given, declared, strict=True)]
        if not all(changed):
            for (time, data), is_changed in zip(self.old, changed, strict=True):
                if is_changed and not self.is_state and time not in self.points:
                    raise ModelError(
                        f"'{data.name}': has {ATTRIBUTE_NAMES[attribute]} of its own, but no value: the scheme has no "
                        f"collocation point at {domain.local_name} = {time:g}. Take them away, or choose a scheme with "
                        "a point there."
                    )
            return
        first = getattr(self.new[0][1], attribute)
        if self.is_in_blocks and not all(_same(getattr(data, attribute), first) for _, data in self.new):
            return  # the rule of a block gives each point its own
        if not all(_same(bound, given[0]) for bound in given):
            (first, data), (last, other) = self.old[0], self.old[-1]
            raise ModelError(
                f"'{data.name}' and '{other.name}': their {ATTRIBUTE_NAMES[attribute]} were set to {_text(given[0])} "
                f"and {_text(given[-1])}; what holds between {first:g} and {last:g} is unknown. Give the variable "
                f"{'domain' if attribute == 'domain' else 'bounds'}=... as a function of '{domain.name}', or set them "
                "after the transformation."
            )
        for _, data in self.new:
            setattr(data, attribute, given[0])

    def _interpolate_values(self, initial: list[Any]) -> None:
        known = [(time, data.value) for time, data in self.old if data.value is not None]
        if not known:
            return
        kept = any(
            number is not None and data.value == number for number, (_, data) in zip(initial, self.old, strict=True)
        )
        if kept and all(data.value is not None for _, data in self.new):
            return
        known.sort()
        times, values = np.array([time for time, _ in known], dtype=float), np.array([number for _, number in known])
        for (_, data), number in zip(self.new, np.interp([time for time, _ in self.new], times, values), strict=True):
            set_initial_value(data, float(number))

    def _inherit_fixing(self, initial: list[Any], domain: Any) -> None:
        if not all(data.fixed for _, data in self.old):
            return
        values = [data.value for _, data in self.old]
        if all(number == values[0] for number in values):
            for _, data in self.new:
                data.fix(values[0], skip_validation=True)
            return
        if values == initial:
            for _, data in self.new:
                data.fix()
            return
        names = ", ".join(f"'{data.name}' at {_text(data.value)}" for _, data in self.old)
        raise ModelError(
            f"{names}: fixed at different values; the values between are unknown. Fix one value, give the variable "
            f"initialize=... as a function of '{domain.name}' before fixing it, or fix it after the transformation."
        )


def _as_declared(data: Any) -> Any:
    """A variable as its declaration makes it, which takes no place in the model."""
    component, index = data.parent_component(), data.index()
    _variable(component, index)
    declared = component[index]
    parts_of(component)[index] = data
    return declared


def set_initial_value(data: Any, number: float) -> None:
    """Set the initial value of a variable, projected onto its bounds."""
    data.set_value(within_bounds(number, data), skip_validation=True)


def _same(one: Any, other: Any) -> bool:
    return one is other or bool(_comparable(one) == _comparable(other))


def _comparable(bound: Any) -> Any:
    """A number, None where it is infinite; an expression by its value, which is no number that was given."""
    if bound.__class__ in native_numeric_types:
        return None if abs(bound) == float("inf") else bound
    return ("expression", value(bound, exception=False)) if isinstance(bound, NumericValue) else bound


def _text(given: Any) -> str:
    return f"{given:g}" if given.__class__ in native_numeric_types else str(given)
