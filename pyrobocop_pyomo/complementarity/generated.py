"""The block that is generated for a relaxation: its components, and how parts are put into them."""

from __future__ import annotations

from collections import Counter
from typing import Any

from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.base.set import NonNegativeIntegers
from pyomo.core.base.var import Var, VarData

from pyrobocop_pyomo.modeling.bulk_parts import new_row, new_variable, put_part

from .record import RelaxationRecord

# Type and purpose of the components that a generated block may have.
_COMPONENTS: dict[str, tuple[type, str]] = {
    "rows": (Constraint, "bound the products"),
    "sides": (Constraint, "keep the signs of the sides"),
    "lifted": (Var, "stand for sides that are no variables"),
    "definitions": (Constraint, "define the lifted variables"),
}


class GeneratedBlock:
    """A generated block that is in no model yet, while parts are added to it.

    Parameters
    ----------
    record : RelaxationRecord
        With the main block, its relaxation and its delta.
    block : Block
        Where the parts are put.
    counts : Counter
        Of the parts on all blocks of the relaxation, by component: these have different indices.

    Attributes
    ----------
    bound : ParamData or VarData
        Bound of the products: delta, or the variable of the penalty term.
    """

    __slots__ = ("_components", "_counts", "block", "bound", "record")

    def __init__(self, record: RelaxationRecord, block: Any, counts: Counter[str]) -> None:
        self.record = record
        self.block = block
        main = record.main
        self.bound = main.delta if main.component("excess") is None else main.excess
        self._counts = counts
        self._components: dict[str, Any] = {}
        for name in ("rows", "sides"):
            self._component(name)

    def _component(self, name: str) -> Any:
        component = self._components.get(name)
        if component is None:
            kind, purpose = _COMPONENTS[name]
            options = {"dense": False} if kind is Var else {}
            component = self._components[name] = kind(NonNegativeIntegers, doc=purpose, **options)
            self.block.add_component(name, component)
        return component

    def _take_position(self, name: str) -> int:
        self._counts[name] += 1
        return self._counts[name] - 1

    def put_row(self, name: str, expression: Any, sources: list[Any]) -> ConstraintData:
        """Make a row, put it into its component, and remember its sources."""
        position = self._take_position(name)
        row = new_row(self._component(name), position, expression)
        self.record.origins[name, position] = sources
        for source in sources:
            self.record.statements[source].rows += (row,)
        return row

    def put_variable(self, start: float) -> VarData:
        """Make a nonnegative variable that stands for a side."""
        component = self._component("lifted")
        variable = new_variable(component, 0, start)
        put_part(component, self._take_position("lifted"), variable)
        return variable
