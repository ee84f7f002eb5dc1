"""The record of a relaxed model: which rows came from which pairs, and how to revert."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from pyomo.common.autoslots import AutoSlots
from pyomo.common.collections import ComponentMap
from pyomo.core.base.block import Block

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES, enclosing_blocks

from .canonical import CanonicalForm, CanonicalPair

BLOCK_NAME = "relaxed_complementarity"


@dataclass(eq=False, slots=True)
class RelaxedPair:
    """A pair, and the expressions of its sides in the generated rows.

    Attributes
    ----------
    a, b : Pyomo expression
        The sides themselves, or generated variables.
    a_slack, b_slack : ParamData or None
        How far the side may be negative, if the relaxation decides that for each side.
    """

    pair: CanonicalPair
    a: Any
    b: Any
    group: Any = None
    a_slack: Any = None
    b_slack: Any = None


@dataclass(eq=False, slots=True)
class PairGroup:
    """Pairs that are relaxed together, and all that was generated for them.

    There may be as many groups as pairs, so empty attributes are one shared tuple and not a list for each group.

    Attributes
    ----------
    home : Block
        The model or a disjunct.
    name : hashable or None
        None where no pair can join later.
    rows : sequence of ConstraintData
        Relax the products, in their order; none where the products are in the penalty term.
    shares : sequence of VarData
        Share of each product in delta, where residuals cannot be added up.
    budgets : sequence of ConstraintData
        The shares sum up to delta at most.
    states : sequence of ParamData
        A bound per row, or a multiplier per product, where the relaxation keeps one.
    """

    home: Any
    name: Hashable | None
    pairs: Sequence[RelaxedPair] = ()
    rows: Sequence[Any] = ()
    shares: Sequence[Any] = ()
    budgets: Sequence[Any] = ()
    states: Sequence[Any] = ()


@dataclass(eq=False, slots=True)
class RelaxedStatement:
    """A declared statement, its pairs, and what was generated for its sides alone."""

    form: CanonicalForm
    pairs: Sequence[RelaxedPair] = ()
    rows: tuple[Any, ...] = ()
    variables: tuple[Any, ...] = ()


@dataclass(eq=False)
class AppliedRelaxation:
    """What one call of `relax` changed beside the rows."""

    sources: list[Any]
    deactivated: list[Any]
    previous_delta: float | None


class RelaxationRecord(AutoSlots.Mixin):
    """Private data of the generated block.

    Components are kept as components, and maps as `ComponentMap`, so that a clone or an unpickled model has a record
    of its own parts.

    Attributes
    ----------
    main : Block or None
        The generated block that holds delta; None on a block that this package did not generate.
    blocks : ComponentMap
        From the model, and from each disjunct with pairs of its own, to the generated block there.
    abilities : Abilities
        Of the relaxation.
    groups : list of PairGroup
        In the order of their first pairs.
    named_groups : dict
        The groups that other pairs may join, by name.
    statements : ComponentMap
        From the source to its `RelaxedStatement`.
    origins : dict
        From component and index of a generated row to the sources of its pairs.
    """

    def __init__(self) -> None:
        self.main: Any = None
        self.relaxation: Any = None
        self.abilities: Any = None
        self.grouping: Any = None
        self.lift = False
        self.objective: Any = None
        self.applications: dict[int, AppliedRelaxation] = {}
        self.groups: list[PairGroup] = []
        self.named_groups: dict[Hashable, PairGroup] = {}
        self.blocks = ComponentMap()
        self.statements = ComponentMap()
        self.origins: dict[tuple[str, int], list[Any]] = {}
        self.next_application = 0
        self.next_positions: dict[str, int] = {}

    def take_position(self, component: str) -> int:
        """Return an index that no part of this component has ever had."""
        position = self.next_positions.get(component, 0)
        self.next_positions[component] = position + 1
        return position

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
            if record.main is component:
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
