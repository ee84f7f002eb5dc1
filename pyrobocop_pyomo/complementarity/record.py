"""What a relaxed model remembers: which rows came from which pairs, and how to go back."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from pyomo.common.autoslots import AutoSlots
from pyomo.common.collections import ComponentMap
from pyomo.core.base.block import Block

from pyrobocop_pyomo.errors import ComplementarityError

from .canonical import CanonicalForm, CanonicalPair
from .pairs import BLOCK_TYPES

BLOCK_NAME = "relaxed_complementarity"


@dataclass(eq=False, slots=True)
class RelaxedPair:
    """A pair, and what stands for its sides in the generated rows.

    Attributes
    ----------
    pair : CanonicalPair
    a, b : Pyomo expression
        The sides themselves, or generated variables.
    group : Group
        With which other pairs it is relaxed.
    a_slack, b_slack : ParamData or None
        How far the side may be negative, where the relaxation decides that for each side.
    """

    pair: CanonicalPair
    a: Any
    b: Any
    group: Any = None
    a_slack: Any = None
    b_slack: Any = None


@dataclass(eq=False, slots=True)
class Group:
    """Pairs that are relaxed together, and all that was generated for them.

    There may be as many groups as pairs: what stays empty is one shared tuple, and not a list for each group.

    Attributes
    ----------
    home : Block
        The model or a disjunct.
    name : hashable or None
        None where no pair can join later.
    pairs : sequence of RelaxedPair
    rows : sequence of ConstraintData
        That relax, in the order of the products; none where the objective pays.
    shares : sequence of VarData
        What each product gets of delta, where residuals cannot be added up.
    budgets : sequence of ConstraintData
        Say that the shares sum up to delta at most.
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
class Application:
    """What one call of the transformation changed beyond the rows."""

    sources: list[Any]
    deactivated: list[Any]
    previous_delta: float | None


class Record(AutoSlots.Mixin):
    """Private data of the generated block.

    Components are kept as components, and maps as `ComponentMap`: a clone or an unpickled model then
    carries a record of its own parts.

    Attributes
    ----------
    main : Block or None
        The generated block that holds delta; None on a block that this package did not generate.
    blocks : ComponentMap
        From the model, and from each disjunct with pairs of its own, to the generated block there.
    abilities : Abilities
        Of the relaxation.
    groups : list of Group
        In the order of their first pairs.
    named_groups : dict
        Of those groups that other pairs may join, from the name.
    statements : ComponentMap
        From the source to what became of it.
    origins : dict
        From component and index of a generated row to the sources of its pairs.
    """

    __slots__ = (
        "abilities",
        "applications",
        "blocks",
        "grouping",
        "groups",
        "lift",
        "main",
        "named_groups",
        "next_application",
        "next_positions",
        "objective",
        "origins",
        "relaxation",
        "statements",
    )

    def __init__(self) -> None:
        self.main: Any = None
        self.relaxation: Any = None
        self.abilities: Any = None
        self.grouping: Any = None
        self.lift = False
        self.objective: Any = None
        self.applications: dict[int, Application] = {}
        self.groups: list[Group] = []
        self.named_groups: dict[Hashable, Group] = {}
        self.blocks = ComponentMap()
        self.statements = ComponentMap()
        self.origins: dict[tuple[str, int], list[Any]] = {}
        self.next_application = 0
        self.next_positions: dict[str, int] = {}

    def take_position(self, component: str) -> int:
        """Return an index that no part of this component had before, also not one that was taken away."""
        position = self.next_positions.get(component, 0)
        self.next_positions[component] = position + 1
        return position

    @property
    def relaxed_pairs(self) -> Iterator[RelaxedPair]:
        """All pairs, in the order in which they came."""
        for statement in self.statements.values():
            yield from statement.pairs


Block.register_private_data_initializer(Record)


def record_of(block: Any) -> Record:
    """Return the record of a generated block; on another block, an empty one with ``main`` None."""
    return block.private_data()


def record_on(block: Any) -> Record | None:
    """Return the record of the relaxation that was applied to this very block, if any."""
    for component in block.component_objects(Block, descend_into=False):
        # The name is looked at first so that no private data appear on blocks of the user.
        if component.local_name.startswith(BLOCK_NAME) and not component.is_indexed():
            record = record_of(component)
            if record.main is component:
                return record
    return None


def records_below(block: Any) -> Iterator[Record]:
    """Yield the records of this block and of all blocks in it."""
    for part in block.block_data_objects(active=None, descend_into=BLOCK_TYPES):
        record = record_on(part)
        if record is not None:
            yield record


def records_above(component: Any) -> Iterator[Record]:
    """Yield the records of all blocks that contain the component."""
    block = component.parent_block()
    while block is not None:
        record = record_on(block)
        if record is not None:
            yield record
        block = block.parent_block()


def only_record(model: Any) -> Record:
    """Return the record of the one relaxation in this block and in what it contains.

    Raises
    ------
    ComplementarityError
        If there is none, or if there are several.
    """
    records = list(records_below(model))
    if len(records) != 1:
        names = ", ".join(f"'{record.main.name}'" for record in records) or "none"
        raise ComplementarityError(f"'{model.name}': expected one relaxation in it, found {names}.")
    return records[0]
