"""The record of a relaxed model: which rows came from which pairs, and how to revert."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from pyomo.common.autoslots import AutoSlots
from pyomo.common.collections import ComponentMap
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.var import VarData

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES, enclosing_blocks
from pyrobocop_pyomo.modeling.pyomo_internals import new_row, new_variable, put_part

from .forms import CanonicalForm, CanonicalPair

BLOCK_NAME = "relaxed_complementarity"


@dataclass(eq=False, slots=True)
class RelaxedPair:
    """A pair, and the expressions of its sides in the generated rows.

    Attributes
    ----------
    a, b : Pyomo expression
        The sides themselves, or generated variables.
    """

    pair: CanonicalPair
    a: Any
    b: Any


@dataclass(eq=False, slots=True)
class RelaxedStatement:
    """A declared statement, its pairs, and the rows that were generated for it."""

    form: CanonicalForm
    pairs: Sequence[RelaxedPair] = ()
    rows: tuple[Any, ...] = ()


class RelaxationRecord(AutoSlots.Mixin):
    """Private data of the generated block.

    Components are kept as components, and maps as `ComponentMap`, so that a clone or an unpickled model has a record
    of its own parts.

    Attributes
    ----------
    main : Block or None
        The generated block; None on a block that this package did not generate.
    penalises_products : bool
        The objective has the products themselves as a term.
    shifts : bool
        delta moves the bounds of the rows and nothing else of the model.
    products : list of lists of Product
        Those that share one bound each.
    bounds : list of ConstraintData
        The rows that bound them.
    statements : ComponentMap
        From the source to its `RelaxedStatement`.
    origins : dict
        From component and index of a generated row to the sources of its pairs.
    """

    def __init__(self) -> None:
        self.main: Any = None
        self.relaxation: Any = None
        self.penalises_products = False
        self.shifts = False
        self.grouping: Any = None
        self.lift = False
        self.objective: Any = None
        self.products: list[list[Any]] = []
        self.bounds: list[Any] = []
        self.statements = ComponentMap()
        self.origins: dict[tuple[str, int], list[Any]] = {}

    @property
    def bound(self) -> Any:
        """Bound of the products: delta, or the variable of the penalty term."""
        return self.main.delta if self.main.component("excess") is None else self.main.excess

    def put_row(self, name: str, expression: Any, sources: list[Any]) -> ConstraintData:
        """Make a row, put it into its component, and remember its sources."""
        component = self.main.component(name)
        position = len(component)
        row = new_row(component, position, expression)
        self.origins[name, position] = sources
        for source in sources:
            self.statements[source].rows += (row,)
        return row

    def put_variable(self, start: float) -> VarData:
        """Make a nonnegative variable that stands for a side."""
        lifted = self.main.lifted
        variable = new_variable(lifted, 0, start)
        put_part(lifted, len(lifted), variable)
        return variable

    @property
    def relaxed_pairs(self) -> Iterator[RelaxedPair]:
        """All pairs, in the order in which they were relaxed."""
        return (pair for statement in self.statements.values() for pair in statement.pairs)


Block.register_private_data_initializer(RelaxationRecord)


def record_of(block: Any) -> RelaxationRecord:
    """Return the record of a generated block; on another block, an empty one with ``main`` None."""
    return block.private_data()


def record_on(block: Any) -> RelaxationRecord | None:
    """Return the record of the relaxation that was applied to this very block, if any."""
    for component in block.component_objects(Block, descend_into=False):
        # The name is looked at first so that no private data appear on blocks of the user.
        if component.local_name.startswith(BLOCK_NAME) and not component.is_indexed():
            record = record_of(component)
            if record.main is not None:
                return record
    return None


def records_below(block: Any) -> Iterator[RelaxationRecord]:
    """Return the records of this block and of all blocks in it."""
    parts = block.block_data_objects(active=None, descend_into=BLOCK_TYPES)
    return (record for part in parts if (record := record_on(part)) is not None)


def records_above(component: Any) -> Iterator[RelaxationRecord]:
    """Return the records of all blocks that contain the component."""
    return (record for block in enclosing_blocks(component) if (record := record_on(block)) is not None)


def only_record(model: Any) -> RelaxationRecord:
    """Return the record of the one relaxation in this block and in what it contains; none or several are refused."""
    records = list(records_below(model))
    if len(records) != 1:
        names = ", ".join(f"'{record.main.name}'" for record in records) or "none"
        raise ComplementarityError(f"'{model.name}': expected one relaxation in it, found {names}.")
    return records[0]
