"""The block that is generated for a relaxation: its components, and how parts are put into them."""

from __future__ import annotations

from collections import Counter
from typing import Any

from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.base.set import NonNegativeIntegers
from pyomo.core.base.var import Var, VarData

from pyrobocop_pyomo.modeling.bulk_parts import new_row, new_variable, put_part

from .record import RelaxationRecord


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

    def __init__(self, record: RelaxationRecord, block: Any, counts: Counter[str]) -> None:
        self.record = record
        self.block = block
        main = record.main
        self.bound = main.delta if main.component("excess") is None else main.excess
        self._counts = counts
        block.rows = Constraint(NonNegativeIntegers, doc="bound the products")
        block.sides = Constraint(NonNegativeIntegers, doc="keep the signs of the sides")
        block.lifted = Var(NonNegativeIntegers, dense=False, doc="stand for sides that are no variables")
        block.definitions = Constraint(NonNegativeIntegers, doc="define the lifted variables")

    def _take_position(self, name: str) -> int:
        self._counts[name] += 1
        return self._counts[name] - 1

    def put_row(self, name: str, expression: Any, sources: list[Any]) -> ConstraintData:
        """Make a row, put it into its component, and remember its sources."""
        position = self._take_position(name)
        row = new_row(self.block.component(name), position, expression)
        self.record.origins[name, position] = sources
        for source in sources:
            self.record.statements[source].rows += (row,)
        return row

    def put_variable(self, start: float) -> VarData:
        """Make a nonnegative variable that stands for a side."""
        variable = new_variable(self.block.lifted, 0, start)
        put_part(self.block.lifted, self._take_position("lifted"), variable)
        return variable
