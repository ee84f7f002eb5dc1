"""Components at the new points of a continuous set: their data, and what variables inherit from the old points.

Bounds and domains of the declaration hold at every point; Pyomo sees to that. What was set afterwards, by
``x.setub(3)`` or ``u.fix(0)``, exists at the first points only, and has to be told from a boundary condition. The
rules, for each variable with its other indices:

* changed at every point and equal: it was meant for all points;
* changed at some points only: a condition at these points;
* changed at every point and different: ambiguous, refused;
* fixed at every point: a control or an algebraic is fixed everywhere, if at one value or at its declared ones; a state
  is not, since fixing it at both ends is how boundary conditions are stated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint, ConstraintData, ConstraintList
from pyomo.core.base.expression import Expression
from pyomo.core.base.param import Param
from pyomo.core.base.piecewise import Piecewise
from pyomo.core.base.set import Set, SetOf
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import Var, VarData
from pyomo.core.expr import EqualityExpression
from pyomo.core.expr.numvalue import native_numeric_types, value
from pyomo.dae import DerivativeVar, Integral
from pyomo.mpec import Complementarity as MpecComplementarity

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.bulk_parts import copy_variable, new_row
from pyrobocop_pyomo.modeling.failures import failures_as
from pyrobocop_pyomo.modeling.variable_values import within_bounds

from .structure import PAIRS, Spot, axis_on

# In this order: a rule uses components that come before its own. Blocks and expressions that are used earlier are made
# on demand by Pyomo.
ORDER = (Param, Var, DerivativeVar, Block, Expression, Constraint, Complementarity, MpecComplementarity)
LEFT_ALONE = (Integral, Set, SetOf, Suffix)
ATTRIBUTES = ("lower", "upper", "domain")
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
        if component.ctype in (Constraint, *PAIRS) and len(component._data) > 0 and _without_rule(component):
            raise ModelError(
                f"'{component.name}': is indexed by '{domain.name}' but has no function as its rule, so that its rows "
                "at new points are unknown. Give it rule=..., or build it after the transformation."
            )


def expand(spots: list[Spot], domain: Any) -> None:
    """Add what is missing at points of a continuous set.

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
            if axis is None or (ctype in (Constraint, *PAIRS) and _without_rule(component)):
                continue
            known = {axis.others(index) for index in component}
            all_inactive = len(component._data) > 0 and not any(
                getattr(data, "active", True) for data in component._data.values()
            )
            create = _CREATORS.get(ctype, _by_asking)
            # The index set does not change in this loop: no rule of a model adds points.
            missing = [
                index
                for index in component.index_set()
                if index not in component._data and (ctype is not Var or axis.others(index) in known)
            ]
            alike = 1 if ctype in (Var, DerivativeVar) and _says_the_same_everywhere(component) else len(missing)
            for index in missing[:alike]:
                with failures_as(ModelError, f"'{component.name}': its rule failed at the new point {index}"):
                    create(component, index)
            if missing[alike:]:
                copy_variable(component._data[missing[0]], missing[alike:])
            for index in missing:
                if all_inactive and ctype is not Param and index in component._data and hasattr(component, "active"):
                    _deactivate(component._data[index])


def _deactivate(data: Any) -> None:
    if hasattr(data, "deactivate"):
        data.deactivate()


def _by_asking(component: Any, index: Any) -> None:
    """As Pyomo does: looking up a missing index runs the rule, and a piecewise function is added to."""
    if index in component._data:
        return
    if isinstance(component, Piecewise):
        component.add(index)
    else:
        component._getitem_when_not_present(index)


def _row(component: Any, index: Any) -> None:
    row = component._rule(component.parent_block(), index)
    if row.__class__ is EqualityExpression and component._ComponentDataClass is ConstraintData:
        new_row(component, index, row)
    else:
        component._setitem_when_not_present(index, row)


def _expression(component: Any, index: Any) -> None:
    if component._rule is None:
        return
    result = component._rule(component.parent_block(), index)
    if result is not Expression.Skip:
        component._setitem_when_not_present(index, result)


def _parameter(component: Any, index: Any) -> None:
    """The initial value where a function or a number gives it; a default needs no entry."""
    rule = component._rule
    if rule is None or rule.contains_indices():
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


def _says_the_same_everywhere(component: Any) -> bool:
    """Whether the declaration of a variable has no rule that looks at the index."""
    rules = component._rule_init, component._rule_bounds, component._rule_domain
    return component._ComponentDataClass is VarData and all(rule is None or rule.constant() for rule in rules)


def _variable(component: Any, index: Any) -> None:
    """As Pyomo makes it; a mapping of initial values that lacks the new point says nothing here."""
    rule = component._rule_init
    if rule is not None and rule.contains_indices() and index not in set(rule.indices()):
        component._rule_init = None
    try:
        component._getitem_when_not_present(index)
    finally:
        component._rule_init = rule


_CREATORS: dict[Any, Callable[[Any, Any], None]] = {
    Param: _parameter,
    Var: _variable,
    DerivativeVar: _variable,
    Constraint: _row,
    Expression: _expression,
}


def _without_rule(component: Any) -> bool:
    if isinstance(component, ConstraintList):
        return True  # never indexed by a set of the user's
    rule = component._init_rule if component.ctype is MpecComplementarity else component._rule
    return rule is None or rule.contains_indices()


@dataclass
class Family:
    """One variable along a continuous set.

    Attributes
    ----------
    is_state : bool
        Whether it has a derivative with respect to the set.
    declared : callable or None
        ``declared(data, attribute)`` is what the declaration of the variable says at a point.
    points : set of float
        The collocation points.
    old, new : list of (time, variable)
    """

    is_state: bool
    declared: Callable[[Any, str], Any] | None
    points: frozenset[float]
    old: list[tuple[float, Any]] = field(default_factory=list)
    new: list[tuple[float, Any]] = field(default_factory=list)

    def inherit(self, domain: Any) -> None:
        """Give the new points what the old ones have.

        Raises
        ------
        ModelError
            When the old points disagree.
        """
        if not self.old or not self.new:
            return
        for attribute in ATTRIBUTES:
            self._inherit(attribute, domain)
        self._interpolate_values()
        if not self.is_state:
            self._inherit_fixing(domain)

    def _declared_at(self, data: Any, attribute: str) -> Any:
        if self.declared is not None:
            return self.declared(data, attribute)
        # A variable within a block: what the block's rule gave it at a new point.
        return getattr(self.new[0][1], "value" if attribute == "initial" else attribute)

    def _inherit(self, attribute: str, domain: Any) -> None:
        given = [getattr(data, attribute) for _, data in self.old]
        changed = [
            not _same(bound, self._declared_at(data, attribute))
            for bound, (_, data) in zip(given, self.old, strict=True)
        ]
        if not all(changed):
            for (time, data), is_changed in zip(self.old, changed, strict=True):
                if is_changed and not self.is_state and time not in self.points:
                    raise ModelError(
                        f"'{data.name}': has {ATTRIBUTE_NAMES[attribute]} of its own, but no value: the scheme has no "
                        f"collocation point at {domain.local_name} = {time:g}. Take them away, or choose a scheme with "
                        "a point there."
                    )
            return
        by_rule = {id(getattr(data, attribute)): getattr(data, attribute) for _, data in self.new}
        if self.declared is None and not all(_same(bound, next(iter(by_rule.values()))) for bound in by_rule.values()):
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

    def _interpolate_values(self) -> None:
        known = [(time, data.value) for time, data in self.old if data.value is not None]
        if not known:
            return
        declared = [self._declared_at(data, "initial") for _, data in self.old]
        kept = any(
            initial is not None and data.value == initial for initial, (_, data) in zip(declared, self.old, strict=True)
        )
        if kept and all(data.value is not None for _, data in self.new):
            return
        known.sort()
        times, values = np.array([time for time, _ in known], dtype=float), np.array([number for _, number in known])
        for (_, data), number in zip(self.new, np.interp([time for time, _ in self.new], times, values), strict=True):
            set_initial_value(data, float(number))

    def _inherit_fixing(self, domain: Any) -> None:
        if not all(data.fixed for _, data in self.old):
            return
        values = [data.value for _, data in self.old]
        if all(number == values[0] for number in values):
            for _, data in self.new:
                data.fix(values[0], skip_validation=True)
            return
        declared = [self._declared_at(data, "initial") for _, data in self.old]
        if self.declared is not None and all(a == b for a, b in zip(values, declared, strict=True)):
            for _, data in self.new:
                data.fix()
            return
        names = ", ".join(f"'{data.name}' at {_text(data.value)}" for _, data in self.old)
        raise ModelError(
            f"{names}: fixed at different values; the values between are unknown. Fix one value, give the variable "
            f"initialize=... as a function of '{domain.name}' before fixing it, or fix it after the transformation."
        )


def declaration_of(component: Any) -> Callable[[Any, str], Any]:
    """A function that returns the declared bounds, domain or initial value of an indexed variable at a point."""

    def declared(data: Any, attribute: str) -> Any:
        parent, index = component.parent_block(), data.index()
        if attribute == "domain":
            return component._rule_domain(parent, index, component)
        if attribute == "initial":
            rule = component._rule_init
            if rule is None or (rule.contains_indices() and index not in set(rule.indices())):
                return None
            return value(rule(parent, index), exception=False)
        side = 0 if attribute == "lower" else 1
        given = component._rule_bounds(parent, index) if component._rule_bounds is not None else None
        bound, implied = (given or (None, None))[side], data.domain.bounds()[side]
        if bound is None or implied is None:
            return implied if bound is None else bound
        # Pyomo shows the tighter one of both as the bound of a variable.
        return (max, min)[side](bound, implied, key=value)

    return declared


def set_initial_value(data: Any, number: float) -> None:
    """Set the initial value of a variable, projected onto its bounds."""
    data.set_value(within_bounds(number, data), skip_validation=True)


def _same(one: Any, other: Any) -> bool:
    if one is other:
        return True
    if one is None or other is None:
        return _infinite(one) and _infinite(other)
    try:
        return bool(value(one, exception=False) == value(other, exception=False)) and _numeric(one) == _numeric(other)
    except (TypeError, AttributeError):
        return False


def _infinite(bound: Any) -> bool:
    return bound is None or (_numeric(bound) and bound in (float("inf"), float("-inf")))


def _numeric(bound: Any) -> bool:
    return bound.__class__ in native_numeric_types


def _text(given: Any) -> str:
    return f"{given:g}" if _numeric(given) else str(given)
