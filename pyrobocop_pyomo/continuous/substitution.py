"""Explicit equations: the right-hand side takes the place of the derivative, which saves half of the variables.

An equation is explicit when a row says ``dx[t] == f``, not just within a disjunct, and the derivative is found nowhere
else, at each collocation point. The row is deactivated, ``f`` goes into the collocation rows, and under the name of the
derivative there is then an expression, ``f`` itself: it can be read after a solve, by whatever solver, and used in
further rows.
"""

from __future__ import annotations

from typing import Any

from pyomo.common.modeling import unique_component_name
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.objective import Objective
from pyomo.core.expr import EqualityExpression
from pyomo.dae import DerivativeVar
from pyomo.gdp import Disjunct

from .absent import PAIRS, variables_of
from .derivatives import retie, rows_of, state_ids
from .expressions import variables_in
from .record import Discretisation, Substitution
from .structure import Spot


def substitute_derivatives(done: Discretisation, found: list[Spot]) -> None:
    """Put right-hand sides in the place of all derivatives that are given explicitly."""
    candidates = {
        id(data): data
        for _, derivative in done.derivatives
        if isinstance(derivative, DerivativeVar) and not derivative.is_reference()
        for data in derivative.values()
        if not data.fixed and data.lower is None and data.upper is None
    }
    for each in state_ids(done):
        candidates.pop(each, None)
    explicit = _explicit_rows(found, candidates, {id(rows) for rows in rows_of(done)})
    for state, derivative in list(done.derivatives):
        needed = [data for data in derivative.values() if not (data.fixed and data.value is None)]
        if needed and all(id(data) in explicit for data in needed):
            _substitute(done, state, derivative, needed, explicit)


def bring_back(done: Discretisation) -> None:
    """Put the derivatives and their equations back where they were declared."""
    for each in done.substitutions:
        for row in each.rows:
            row.activate()
        for data, value in each.values:
            data.unfix()
            data.set_value(value, skip_validation=True)
        each.parent.del_component(each.expression)
        each.derivative.parent_block().del_component(each.derivative)
        each.parent.add_component(each.name, each.derivative)
    done.substitutions.clear()


def _explicit_rows(found: list[Spot], candidates: dict[int, Any], own: set[int]) -> dict[int, tuple[Any, Any]]:
    """For each candidate that one row gives and nothing else holds: the row and the right-hand side."""
    explicit: dict[int, tuple[Any, Any]] = {}
    elsewhere: set[int] = set()
    for spot in found:
        component = spot.component
        if (
            not spot.active
            or component.ctype not in (Constraint, Objective, Expression, *PAIRS)
            or id(component) in own
        ):
            continue
        unconditional = not _is_within_a_disjunct(component)
        for data in component.values():
            if component.ctype is not Expression and not data.active:
                continue
            expression = data.expr if component.ctype not in PAIRS else None
            if unconditional and isinstance(expression, EqualityExpression):
                left, right = expression.args
                if id(left) not in candidates:
                    left, right = right, left
                if id(left) in candidates and id(left) not in explicit:
                    explicit[id(left)] = (data, right)
                    elsewhere.update(id(each) for each in variables_in(right) if id(each) in candidates)
                    continue
            elsewhere.update(id(each) for each in variables_of(data) if id(each) in candidates)
    return {key: value for key, value in explicit.items() if key not in elsewhere}


def _is_within_a_disjunct(component: Any) -> bool:
    block = component.parent_block()
    while block is not None:
        if block.ctype is Disjunct:
            return True
        block = block.parent_block()
    return False


def _substitute(
    done: Discretisation, state: Any, derivative: Any, needed: list[Any], explicit: dict[int, tuple[Any, Any]]
) -> None:
    sides = {data.index(): explicit[id(data)][1] for data in needed}
    home = retie(done, state, derivative, sides)
    rows, values = [explicit[id(data)][0] for data in needed], [(data, data.value) for data in needed]
    for row in rows:
        row.deactivate()
    for data in needed:
        data.fix(None, skip_validation=True)
        data.stale = True
    parent, name = derivative.parent_block(), derivative.local_name
    parent.del_component(derivative)
    home.add_component(unique_component_name(home, f"{name}_variable"), derivative)
    expression = Expression(derivative.index_set(), initialize=sides)
    parent.add_component(name, expression)
    done.substitutions.append(Substitution(parent, name, derivative, expression, rows, values))
