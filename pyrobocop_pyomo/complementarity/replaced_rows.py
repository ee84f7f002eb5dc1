"""Transformations that say rows, objectives or pairs in another way, on blocks of their own, and take it back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

from pyomo.common.autoslots import AutoSlots
from pyomo.common.config import ConfigDict, ConfigValue
from pyomo.common.modeling import unique_component_name
from pyomo.core.base import Transformation
from pyomo.core.base.block import Block

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES, deactivate

from .pairs import active_parts, home_of
from .preconditions import refuse_foreign_token, refuse_unusable


class ReplacementRecord(AutoSlots.Mixin):
    """Private data of a generated block.

    Attributes
    ----------
    rows : list of (component data, expression or None) or None
        What was replaced, with what it held before; None for an expression that was deactivated as it is. None in all
        on a block that this package did not generate.
    """

    __slots__ = ("rows",)

    def __init__(self) -> None:
        self.rows: list[tuple[Any, Any]] | None = None


Block.register_private_data_initializer(ReplacementRecord)


@dataclass(frozen=True, eq=False)
class ReplacementToken:
    """What ``revert`` of a transformation needs to undo one application.

    Attributes
    ----------
    model : Block
        The model that was transformed.
    blocks : tuple of Block
        They hold what was generated: one on the model, and one in each disjunct of whose pairs some are replaced.
    """

    model: Any
    blocks: tuple[Any, ...]


class RowReplacement(Transformation):
    """What such transformations share: targets, the block, the record and the way back.

    Subclasses say what they make of the rows. A model that is refused stays as it was.
    """

    CONFIG = ConfigDict("what is replaced")
    CONFIG.declare("targets", ConfigValue(None, description="Blocks, components or their parts to take; default all."))

    kinds: ClassVar[tuple[type, ...]]
    containers: ClassVar[tuple[type, ...]]
    block_name: ClassVar[str]
    generated: ClassVar[str]  # in words, for messages

    def _apply_to(self, model: Any, **options: Any) -> ReplacementToken:
        targets = self.CONFIG({**options.pop("options", {}), **options}).targets
        refuse_unusable(model)
        homes: dict[int, tuple[Any, list[Any]]] = {}
        for row in self._rows(model, targets):
            home = home_of(row.parent_block(), model)
            homes.setdefault(id(home), (home, []))[1].append(row)
        # All that can fail is done on blocks that are no part of the model yet.
        filled = []
        for home, rows in homes.values():
            block = Block(concrete=True)
            if replaced := self._fill(block, rows):
                filled.append((home, block, replaced))
        if not filled:
            where = "it" if targets is None else "the targets"
            raise ComplementarityError(f"'{model.name}': {self._nothing_found(where)}")
        for home, block, replaced in filled:
            home.add_component(unique_component_name(home, self.block_name), block)
            _record_of(block).rows = [(row, None if new is None else row.expr) for row, new in replaced]
            deactivate(row for row, new in replaced if new is None)
            for row, new in replaced:
                if new is not None:
                    row.set_value(new)
        return ReplacementToken(model, tuple(block for _, block, _ in filled))

    def _fill(self, block: Any, rows: list[Any]) -> list[tuple[Any, Any]]:
        """Put on the block what stands for some of the rows.

        Returns
        -------
        list of (component data, expression or None)
            Those rows, with what they hold from now on; None for one to deactivate.
        """
        raise NotImplementedError

    def _nothing_found(self, where: str) -> str:
        raise NotImplementedError

    def revert(self, model: Any, token: ReplacementToken | None = None) -> None:
        """Undo one application, or all of them.

        Parameters
        ----------
        model : Block
            The model that `apply_to` was called with.
        token : ReplacementToken, optional
            What `apply_to` returned. Without it everything on this model is undone, which also serves a clone.

        Raises
        ------
        ComplementarityError
            If there is nothing to undo, or if the token is used up or belongs to another model.
        """
        refuse_foreign_token(model, token)
        present = list(self._generated_on(model))
        wanted = present if token is None else [block for block in present if any(block is one for one in token.blocks)]
        if not wanted:
            raise ComplementarityError(
                f"'{model.name}': nothing to revert; it has no {self.generated}, or was reverted before."
            )
        for block in reversed(wanted):  # the last one holds what the first one made of a row
            rows = rows_of_block(block)
            block.parent_block().del_component(block)
            for row, expression in rows or ():
                if expression is None:
                    row.activate()
                else:
                    row.set_value(expression)

    def _rows(self, model: Any, targets: Any) -> list[Any]:
        return active_parts(model, targets, self.kinds, self.containers)

    def _generated_on(self, model: Any) -> Iterator[Any]:
        for block in model.block_data_objects(active=None, descend_into=BLOCK_TYPES):
            # The name is looked at first so that no private data appear on blocks of the user.
            if block.local_name.startswith(self.block_name) and rows_of_block(block):
                yield block


def rows_of_block(block: Any) -> list[tuple[Any, Any]] | None:
    """What a generated block stands for; see `ReplacementRecord`."""
    return _record_of(block).rows


def _record_of(block: Any) -> ReplacementRecord:
    return block.private_data()
