"""The block that is generated for a relaxation: its components, and how parts are put into them."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.base.param import Param, ParamData
from pyomo.core.base.set import NonNegativeIntegers
from pyomo.core.base.var import Var, VarData
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.modeling.bulk_parts import new_parameter, new_row, new_variable, put_part, remove_part

from .record import RelaxationRecord
from .relaxations.protocol import side_slack

# Type and purpose of the components that a generated block may have.
_COMPONENTS: dict[str, tuple[type, str]] = {
    "rows": (Constraint, "bound or fix the products"),
    "sides": (Constraint, "keep the signs of the sides"),
    "lifted": (Var, "stand for sides that are no variables"),
    "definitions": (Constraint, "define the lifted variables"),
    "shares": (Var, "share of each product in delta"),
    "budgets": (Constraint, "the shares of a group sum up to delta at most"),
    "states": (Param, "numbers of the relaxation that are updated between solves"),
}

OCCASIONAL = ("lifted", "definitions", "shares", "budgets", "states")


def component_of(block: Any, name: str) -> Any:
    """Return the component of this name on a generated block; it is made when it is needed first."""
    component = block.component(name)
    if component is None:
        kind, purpose = _COMPONENTS[name]
        options = {"mutable": True} if kind is Param else {"dense": False} if kind is Var else {}
        component = kind(NonNegativeIntegers, doc=purpose, **options)
        block.add_component(name, component)
    return component


class GeneratedBlock:
    """A generated block while rows are added to it, with what is the same for all of its pairs.

    Looking that up for each pair would take as long as adding a row.

    Parameters
    ----------
    record : RelaxationRecord
        With the main block, its relaxation and its delta.
    block : Block
        Where the parts are put.

    Attributes
    ----------
    bound : ParamData or VarData
        Bound of the products: delta, or the variable of the penalty term.
    slack : number, Pyomo expression or None
        How far a side may fall below zero; None when no row is to keep its sign.
    exact : bool
        Whether the slack is zero.
    """

    __slots__ = ("_components", "block", "bound", "exact", "record", "slack")

    def __init__(self, record: RelaxationRecord, block: Any) -> None:
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
        """Make a variable that is not yet in its component."""
        return new_variable(self.component(name), lower, start)

    def new_state(self, number: float) -> ParamData:
        """Make a mutable parameter that is not yet in its component."""
        return new_parameter(self.component("states"), number)

    def put_row(self, name: str, expression: Any, sources: list[Any]) -> ConstraintData:
        """Make a row, put it into its component, and remember its sources."""
        position = self.record.take_position(name)
        self.record.origins[name, position] = sources
        return new_row(self.component(name), position, expression)

    def put(self, name: str, data: Any) -> None:
        """Put a variable or a parameter into its component."""
        put_part(self.component(name), self.record.take_position(name), data)


def is_zero(slack: Any) -> bool:
    """True when a slack is the number zero, now and later."""
    return slack.__class__ in native_numeric_types and slack == 0


def take_away(record: RelaxationRecord, data: Any) -> None:
    """Delete a row, a variable or a parameter from its component."""
    record.origins.pop((data.parent_component().local_name, data.index()), None)
    remove_part(data)
