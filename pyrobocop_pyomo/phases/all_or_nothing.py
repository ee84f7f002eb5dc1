"""A block that is on the model whole, or not at all."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.global_set import UnindexedComponent_set


class AllOrNothingBlock(Block):
    """Base of the blocks of this package that a rule builds: on any error they leave the model again."""

    def __new__(cls, *args: Any, **kwds: Any) -> Any:
        """Past `Block.__new__`, which knows only its own two classes."""
        return super(Block, cls).__new__(cls)

    def construct(self, data: Any = None) -> None:
        """Build the block; on any error, the user's own included, take it off the model."""
        try:
            super().construct(data)
        except BaseException:
            parent = self.parent_block()
            if parent is not None and parent.component(self.local_name) is self:
                parent.del_component(self)
            raise


def is_scalar(args: tuple[Any, ...]) -> bool:
    """True where the positional arguments of a component are no index sets."""
    return not args or (args[0] is UnindexedComponent_set and len(args) == 1)
