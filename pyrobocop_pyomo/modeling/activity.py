"""What is active: parts of components, and what lies between them and a model."""

from __future__ import annotations

from collections.abc import Iterable
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


def is_inside(component: Any, block: Any) -> bool:
    """Whether the component is in this block, or in one that the block contains."""
    parent = component.parent_block()
    while parent is not None and parent is not block:
        parent = parent.parent_block()
    return parent is block


def outermost_inactive(component: Any, model: Any) -> Any:
    """What is deactivated of a component and the blocks between it and the model: the outermost, or None."""
    found = None
    while component is not None and component is not model:
        found = component if not component.active else found
        component = component.parent_block()
    return found
