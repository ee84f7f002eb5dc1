"""Giving every component that is indexed by a continuous set its data at the set's new points."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint, ConstraintList
from pyomo.core.base.expression import Expression
from pyomo.core.base.param import Param
from pyomo.core.base.set import Set, SetOf
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import Var
from pyomo.dae import DerivativeVar, Integral
from pyomo.mpec import Complementarity as MpecComplementarity

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import PyRobocopError, TranscriptionError

from .structure import Spot, axis_on

# In this order: what rules ask for comes before what asks. Blocks and expressions that are asked for earlier are made
# on demand by Pyomo.
ORDER = (Param, Var, DerivativeVar, Block, Expression, Constraint, Complementarity, MpecComplementarity)
PAIRS = (Complementarity, MpecComplementarity)
LEFT_ALONE = (Integral, Set, SetOf, Suffix)


def refuse_what_cannot_grow(spots: list[Spot], domain: Any) -> None:
    """Raise a `TranscriptionError` that names a component which has no way to get new points."""
    for spot in spots:
        component = spot.component
        if component.ctype in LEFT_ALONE or component.is_reference() or axis_on(component, domain) is None:
            continue
        if component.ctype not in ORDER:
            raise TranscriptionError(
                f"'{component.name}': a {component.ctype.__name__} indexed by '{domain.name}' cannot be discretised. "
                "Build it after the transformation."
            )
        if component.ctype in (Constraint, *PAIRS) and len(component._data) > 0 and _without_rule(component):
            raise TranscriptionError(
                f"'{component.name}': is indexed by '{domain.name}' but has no function as its rule, so that its rows "
                "at new points are unknown. Give it rule=..., or build it after the transformation."
            )


def expand(spots: list[Spot], domain: Any) -> None:
    """Add what is missing at points of a continuous set.

    Raises
    ------
    TranscriptionError
        When a rule fails at a new point.
    """
    for ctype in ORDER:
        for spot in spots:
            component = spot.component
            if component.ctype is not ctype or component.is_reference():
                continue
            axis = axis_on(component, domain)
            # What is empty and has a rule may get rows at new points that it had not at the first ones.
            if axis is None or (ctype in (Constraint, *PAIRS) and _without_rule(component)):
                continue
            known = {axis.others(index) for index in component}
            all_inactive = len(component._data) > 0 and not any(
                getattr(data, "active", True) for data in component._data.values()
            )
            create = _CREATORS.get(ctype, _by_asking)
            # The set of a product does not change while it is walked: no rule of a model adds points.
            missing = [
                index
                for index in component.index_set()
                if index not in component._data and (ctype is not Var or axis.others(index) in known)
            ]
            for index in missing:
                with _naming(component, index):
                    create(component, index)
                if all_inactive and ctype is not Param and index in component._data and hasattr(component, "active"):
                    _put_to_sleep(component._data[index])


def _put_to_sleep(data: Any) -> None:
    if hasattr(data, "deactivate"):
        data.deactivate()


@contextmanager
def _naming(component: Any, index: Any) -> Any:
    try:
        yield
    except PyRobocopError:
        raise
    except Exception as error:
        raise TranscriptionError(
            f"'{component.name}': its rule failed at the new point {index}: {type(error).__name__}: {error}"
        ) from error


def _by_asking(component: Any, index: Any) -> None:
    """Pyomo's own way: looking up an index that is not there yet runs the rule."""
    if index not in component._data:
        component._getitem_when_not_present(index)


def _row(component: Any, index: Any) -> None:
    component._setitem_when_not_present(index, component._rule(component.parent_block(), index))


def _expression(component: Any, index: Any) -> None:
    if component._rule is None:
        return
    answer = component._rule(component.parent_block(), index)
    if answer is not Expression.Skip:
        component._setitem_when_not_present(index, answer)


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


def _variable(component: Any, index: Any) -> None:
    """As Pyomo makes it; a mapping of initial values that lacks the new point is a guess elsewhere only."""
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
