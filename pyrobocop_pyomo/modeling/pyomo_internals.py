"""What Pyomo keeps to itself, and has no public way for: parts, rules, stored bounds, functions of calls.

Pyomo's ways to add one index look up sets, rules and names each time. Whoever makes tens of thousands of parts makes
them here, and adds them when nothing can fail any more.
"""

from __future__ import annotations

from typing import Any

from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.set import Reals
from pyomo.core.base.var import VarData
from pyomo.core.expr.numvalue import native_numeric_types


def new_variable(component: Any, lower: Any, start: float) -> VarData:
    """Make a real variable, not yet in its component; `lower` is None, a number or an expression of parameters."""
    variable = VarData(component)
    # The setters of the domain and of a bound check what is known here, and take longer than all the rest.
    variable._domain = Reals
    if lower.__class__ in native_numeric_types:
        variable._lb = lower
    elif lower is not None:
        variable.setlb(lower)
    variable.set_value(start, skip_validation=True)
    return variable


def new_row(component: Any, index: Any, expression: Any) -> ConstraintData:
    """Make a row and put it into its component."""
    row = ConstraintData(expression, component)
    put_part(component, index, row)
    return row


def parts_of(component: Any) -> dict[Any, Any]:
    """The parts that a component has, by index: none is made, as a default would be."""
    parts: dict[Any, Any] = component._data
    return parts


def stated_rule(component: Any) -> Any:
    """The rule that a component was stated by, as Pyomo wraps it; None where there is none."""
    return component._rule


def put_rule(component: Any, rule: Any) -> None:
    """Let a component make parts by a rule that Pyomo has wrapped, or by none."""
    component._rule = rule


def function_of_call(node: Any) -> Any:
    """The external function that an expression calls."""
    return node._fcn


def stored_bounds(variable: Any) -> tuple[Any, Any]:
    """The bounds of a variable itself: the public ones are joined with those of its domain."""
    return variable._lb, variable._ub


def put_bounds(variable: Any, bounds: tuple[Any, Any]) -> None:
    """Let a variable have bounds that it has had before."""
    variable._lb, variable._ub = bounds


def put_part(component: Any, index: Any, data: Any) -> None:
    """Put a part into its component."""
    data._index = index
    component._data[index] = data
