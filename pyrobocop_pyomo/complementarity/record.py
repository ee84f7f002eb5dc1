"""What a relaxed model remembers: which rows came from which pairs, and how to go back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from pyomo.common.autoslots import AutoSlots
from pyomo.common.collections import ComponentMap
from pyomo.core.base.block import Block

from .canonical import CanonicalForm, CanonicalPair
from .pairs import BLOCK_TYPES

BLOCK_NAME = "relaxed_complementarity"


@dataclass(eq=False)
class Group:
    """Pairs under one row; the row is None where the relaxation charges the objective instead."""

    home: Any
    row: Any = None
    pairs: list[CanonicalPair] = field(default_factory=list)


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
    groups : dict
        From the group's name to its pairs and its row.
    forms, side_rows, group_names : ComponentMap
        From the statement to its canonical form, to the rows that enforce its sides, to the groups of its pairs.
    sources : ComponentMap
        From each generated row to the sources of its pairs.
    """

    __slots__ = (
        "applications",
        "blocks",
        "forms",
        "group_names",
        "grouping",
        "groups",
        "main",
        "next_application",
        "next_positions",
        "objective",
        "relaxation",
        "side_rows",
        "sources",
    )

    def __init__(self) -> None:
        self.main: Any = None
        self.relaxation: Any = None
        self.grouping: Any = None
        self.objective: Any = None
        self.applications: dict[int, Application] = {}
        self.groups: dict[str, Group] = {}
        self.blocks = ComponentMap()
        self.forms = ComponentMap()
        self.group_names = ComponentMap()
        self.side_rows = ComponentMap()
        self.sources = ComponentMap()
        self.next_application = 0
        self.next_positions: dict[str, int] = {}

    @property
    def pairs(self) -> list[CanonicalPair]:
        """All relaxed pairs; a range has two, an equality none."""
        forms: Iterator[CanonicalForm] = self.forms.values()
        return [pair for form in forms for pair in form.pairs]

    def take_position(self, component: str) -> int:
        """Return an index that no row of this component had before, also not one that was taken away."""
        position = self.next_positions.get(component, 0)
        self.next_positions[component] = position + 1
        return position


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
