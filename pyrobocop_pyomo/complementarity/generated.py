"""The parts of a generated block: made and put there in bulk, and taken away again.

Pyomo's ways to add one index look up sets, rules and names each time. Tens of thousands of rows are made here, so the
data objects are made first, without an index, and put into their components when nothing can fail any more.
"""

from __future__ import annotations

from typing import Any

from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.base.param import Param, ParamData
from pyomo.core.base.set import NonNegativeIntegers, Reals
from pyomo.core.base.var import Var, VarData

from .record import Record

# Kind and purpose of what a generated block may hold.
_COMPONENTS: dict[str, tuple[type, str]] = {
    "rows": (Constraint, "bound or fix the products"),
    "sides": (Constraint, "keep the signs of the sides"),
    "lifted": (Var, "stand for sides that are no variables"),
    "definitions": (Constraint, "say what the lifted variables stand for"),
    "shares": (Var, "what each product gets of delta"),
    "budgets": (Constraint, "the shares of a group sum up to delta at most"),
    "states": (Param, "numbers of the relaxation that are updated between solves"),
}

OCCASIONAL = ("lifted", "definitions", "shares", "budgets", "states")


def component_of(block: Any, name: str) -> Any:
    """Return the component of this name on a generated block; made when it is asked for first."""
    component = block.component(name)
    if component is None:
        kind, purpose = _COMPONENTS[name]
        options = {"mutable": True} if kind is Param else {"dense": False} if kind is Var else {}
        component = kind(NonNegativeIntegers, doc=purpose, **options)
        block.add_component(name, component)
    return component


def new_variable(component: Any, lower: Any, start: float) -> VarData:
    """Make a variable of this component, not yet in it; `lower` is None, a number or an expression of parameters."""
    variable = VarData(component)
    # The setter of the domain takes twenty times as long as all the rest.
    variable._domain = Reals
    if lower is not None:
        variable.setlb(lower)
    variable.set_value(start, skip_validation=True)
    return variable


def new_parameter(component: Any, number: float) -> ParamData:
    """Make a mutable parameter of this component, not yet in it."""
    parameter = ParamData(component)
    parameter._value = number
    return parameter


def new_row(component: Any, expression: Any) -> ConstraintData:
    """Make a row of this component, not yet in it."""
    return ConstraintData(expression, component)


def put(record: Record, name: str, data: Any, sources: list[Any] | None = None) -> None:
    """Give what was made an index and put it into its component; remember what a row came from."""
    position = record.take_position(name)
    data._index = position
    data._component()._data[position] = data
    if sources is not None:
        record.origins[name, position] = sources


def take_away(record: Record, data: Any) -> None:
    """Delete a row, a variable or a parameter from its component."""
    component = data.parent_component()
    record.origins.pop((component.local_name, data.index()), None)
    del component._data[data.index()]
