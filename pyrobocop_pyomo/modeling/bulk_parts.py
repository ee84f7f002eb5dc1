"""Parts in bulk: rows, variables and parameters made without an index, then put into their components; or taken off.

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


def put_part(component: Any, index: Any, data: Any) -> None:
    """Put a part into its component."""
    data._index = index
    component._data[index] = data
