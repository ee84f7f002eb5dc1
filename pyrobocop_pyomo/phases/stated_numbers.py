"""Numbers of declarations that Pyomo's users write otherwise: Params, expressions of them, numbers with units."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.base.param import ParamData
from pyomo.core.base.units_container import InconsistentUnitsError, UnitsError
from pyomo.core.base.units_container import units as pyomo_units
from pyomo.core.expr.numvalue import NumericValue, value
from pyomo.core.expr.visitor import identify_mutable_parameters

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expressions import is_indexed_component
from pyrobocop_pyomo.modeling.shared_nodes import variables_in

from .declarations import Declaration, State


def rate_units(units: Any, time_units: Any) -> Any:
    """Units of a derivative, None where there are none at all."""
    if units is None:
        return None if time_units is None else 1 / time_units
    return units if time_units is None else units / time_units


def in_numbers(declaration: Declaration, label: str, time_units: Any) -> Declaration:
    """The declaration in numbers of its units; only what its state is equal to at an end may still change.

    Raises
    ------
    ModelError
        When units do not fit, or a bound may change.
    """
    changed: dict[str, Any] = {}
    units_of = dict.fromkeys(("initial", "final", "bounds", "initial_guess"), declaration.units)
    units_of |= dict.fromkeys(("rate_bounds", "derivative_bounds"), rate_units(declaration.units, time_units))
    for name, units in units_of.items():
        given = getattr(declaration, name, None)
        where = f"{label} (declared at {declaration.declared_at}): its {name.replace('_', ' ')}"
        if is_indexed_component(given):
            raise ModelError(f"{where} is the indexed '{given}'; expected one number. Read it at an index.")
        if isinstance(given, NumericValue):
            found = _in_units(given, units, where)
            keeps = name in ("initial", "final") and _may_change(found)
            changed[name] = found if keeps else value(found, exception=False)
            if changed[name] is None:
                raise ModelError(f"{where} is '{given}', which has no value. Give it one first.")
        elif isinstance(given, tuple) and any(isinstance(side, NumericValue) for side in given):
            changed[name] = tuple(_unchanging(side, units, where) for side in given)
    return replace(declaration, **changed) if changed else declaration


def _unchanging(side: Any, units: Any, where: str) -> Any:
    if not isinstance(side, NumericValue):
        return side
    found = _in_units(side, units, where)
    if _may_change(found):
        raise ModelError(
            f"{where}: the side '{side}' may change. A bound is a number: write {value(found, exception=False)}, or "
            "state a relation that follows it, such as b.constraint(lambda b, t: b.x[t] <= ...)."
        )
    return value(found)


def _in_units(given: Any, units: Any, where: str) -> Any:
    try:
        own = pyomo_units.get_units(given)
        if str(own) == "dimensionless":
            return given if units is None else given * units
        if units is not None:
            return pyomo_units.convert(given, to_units=units)
    except (InconsistentUnitsError, UnitsError) as error:
        raise ModelError(f"{where} is '{given}', which does not fit its units '{units}' ({error}).") from None
    raise ModelError(f"{where} is '{given}', in {own}, but it has no units. Declare it with units={own}.")


def _may_change(expression: Any) -> bool:
    # Units are found among the Params.
    params = any(isinstance(leaf, ParamData) for leaf in identify_mutable_parameters(expression))
    return params or next(variables_in(expression), None) is not None


def add_row_of_end(block: Any, name: str, variable: Any, stated: Any, end: str) -> None:
    """Let a state be what an expression is at an end, now and when the expression changes."""
    block.add_component(_row_name(name, end), Constraint(expr=variable == stated))
    number = value(stated, exception=False)
    if number is not None:
        variable.set_value(number, skip_validation=True)


def rows_of_ends(declarations: dict[str, Declaration]) -> set[str]:
    """Names of all rows of `add_row_of_end`."""
    return {
        _row_name(name, end)
        for name, declaration in declarations.items()
        if isinstance(declaration, State)
        for end in ("initial", "final")
        if isinstance(getattr(declaration, end), NumericValue)
    }


def moving_end(block: Any, name: str, declaration: Declaration, end: str) -> float | None:
    """What the row of an end asks for now; None where there is none. A copy of a model has a row of its own."""
    row = block.component(_row_name(name, end))
    if row is None or not row.active or not isinstance(getattr(declaration, end), NumericValue):
        return None
    return float(value(row.expr.args[1]))


def _row_name(name: str, end: str) -> str:
    return f"{name}_{end}_as_stated"
