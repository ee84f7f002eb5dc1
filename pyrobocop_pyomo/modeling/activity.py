"""What is active: parts of components, and what lies between them and a model."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from pyomo.core.base.block import Block
from pyomo.gdp import Disjunct

# What may contain components, also those that hold only where a disjunct is chosen.
BLOCK_TYPES = (Block, Disjunct)


def deactivate(parts: Iterable[Any]) -> None:
    """Deactivate parts of components, and the components of which no part is left."""
    components = {}
    for part in parts:
        part.deactivate()
        component = part.parent_component()
        components[id(component)] = component
    for component in components.values():
        # Pyomo leaves the flag of the component to whoever changes its parts.
        if not any(part.active for part in component.values()):
            component.deactivate()


def enclosing_blocks(component: Any) -> Iterator[Any]:
    """Yield the block that a component is in, the block that this one is in, and so on."""
    block = component.parent_block()
    while block is not None:
        yield block
        block = block.parent_block()


def is_inside(component: Any, block: Any) -> bool:
    """Whether the component is in this block, or in one that the block contains."""
    return any(enclosing is block for enclosing in enclosing_blocks(component))


def outermost_inactive(component: Any, model: Any) -> Any:
    """What is deactivated of a component and the blocks between it and the model: the outermost, or None."""
    found = None
    while component is not None and component is not model:
        found = component if not component.active else found
        component = component.parent_block()
    return found
