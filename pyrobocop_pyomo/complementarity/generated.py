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
from pyomo.core.expr.numvalue import native_numeric_types

from .record import Record
from .relaxations.protocol import side_slack

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


class GeneratedBlock:
    """A generated block while rows are added to it.

    It keeps what is the same for all pairs of the block, which would cost as much as a row to look up for each.

    Parameters
    ----------
    record : Record
        With the main block, its relaxation and its delta.
    block : Block
        Where the parts are put.

    Attributes
    ----------
    record : Record
    block : Block
    bound : ParamData or VarData
        What the products are bounded by: delta, or the variable that the objective pays for.
    slack : number, Pyomo expression or None
        How far a side may fall below zero; None when no row is to keep its sign.
    exact : bool
        Whether that is not at all.
    """

    __slots__ = ("_components", "block", "bound", "exact", "record", "slack")

    def __init__(self, record: Record, block: Any) -> None:
        self.record = record
        self.block = block
        main = record.main
        self.bound = main.delta if main.component("excess") is None else main.excess
        self.slack = side_slack(record.relaxation, main.delta)
        self.exact = is_zero(self.slack)
        self._components: dict[str, Any] = {}

    def component(self, name: str) -> Any:
        """Return the component of this name."""
        component = self._components.get(name)
        if component is None:
            component = self._components[name] = component_of(self.block, name)
        return component

    def new_variable(self, name: str, lower: Any, start: float) -> VarData:
        """Make a variable, not yet in its component; `lower` is None, a number or an expression of parameters."""
        variable = VarData(self.component(name))
        # The setters of the domain and of a bound check what is known here, and take longer than all the rest.
        variable._domain = Reals
        if lower.__class__ in native_numeric_types:
            variable._lb = lower
        elif lower is not None:
            variable.setlb(lower)
        variable.set_value(start, skip_validation=True)
        return variable

    def new_state(self, number: float) -> ParamData:
        """Make a mutable parameter, not yet in its component."""
        parameter = ParamData(self.component("states"))
        parameter._value = number
        return parameter

    def put_row(self, name: str, expression: Any, sources: list[Any]) -> ConstraintData:
        """Make a row, put it into its component, and remember what it came from."""
        component = self.component(name)
        row = ConstraintData(expression, component)
        position = self.record.take_position(name)
        row._index = position
        component._data[position] = row
        self.record.origins[name, position] = sources
        return row

    def put(self, name: str, data: Any) -> None:
        """Put a variable or a parameter into its component."""
        position = self.record.take_position(name)
        data._index = position
        self.component(name)._data[position] = data


def is_zero(slack: Any) -> bool:
    """True when a slack is the number zero, now and later."""
    return slack.__class__ in native_numeric_types and slack == 0


def take_away(record: Record, data: Any) -> None:
    """Delete a row, a variable or a parameter from its component."""
    component = data.parent_component()
    record.origins.pop((component.local_name, data.index()), None)
    del component._data[data.index()]
