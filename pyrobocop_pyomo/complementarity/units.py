"""Units of pairs: Pyomo's check of units knows the component, and products of sides are taken without units."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.units_container import units
from pyomo.util import check_units

from pyrobocop_pyomo.modeling.expressions import is_plain_variable
from pyrobocop_pyomo.modeling.shared_nodes import variables_in

from .component import Complementarity
from .pairs import canonical_form

# Pyomo makes its container of units when it is first used.
_NOT_USED_YET = "_DeferredUnitsSingleton"


def without_units(side: Any) -> Any:
    """A side divided by its unit, so that products and sums of sides of all kinds may be compared with one number.

    The side itself where it has no units, which is found out at no cost in a program that uses none.
    """
    unit = _unit_of(side)
    return side if unit is None else side / unit


def in_units_of(term: Any, reference: Any) -> Any:
    """A term without units times the unit of what it is added to."""
    unit = _unit_of(reference)
    return term if unit is None else term * unit


def _unit_of(expression: Any) -> Any:
    if type(units).__name__ == _NOT_USED_YET:
        return None
    plain = is_plain_variable(expression)
    variables = [expression] if plain else variables_in(expression, include_fixed=True)
    if all(variable.parent_component().get_units() is None for variable in variables):
        return None
    unit = units.get_units(expression)
    return None if unit is None or str(unit) == "dimensionless" else unit


def check_units_of_pair(data: Any) -> None:
    """Raise Pyomo's `UnitsError` where the parts of a side have units that do not fit together."""
    form = canonical_form(data)
    for pair in form.pairs:
        check_units.assert_units_consistent(pair.a)
        check_units.assert_units_consistent(pair.b)
    for row in form.rows:
        check_units.assert_units_equivalent(*row.args)


def register_with_pyomo() -> None:
    """Enter the component into the table by which `pyomo.util.check_units` goes; it has none for pairs of any kind."""
    getattr(check_units, "_component_data_handlers", {}).setdefault(Complementarity, check_units_of_pair)
