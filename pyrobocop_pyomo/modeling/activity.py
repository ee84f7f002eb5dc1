"""What is active: parts of components, and what lies between them and a model.

Variables that belong to another model than the one that reads them: nothing of that model holds for them there.
"""

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


ONE_MODEL = "Put both into one model, as two blocks or phases of it, or give numbers: pyo.value(...), a Param, a table."


def foreign_variable(of: Any, variables: Iterable[Any]) -> Any:
    """One of several variables that belongs to another model than a block or a variable does; None where none does.

    What belongs to no model, such as a variable that was deleted, is of no other model.
    """
    own = of.model()
    # Many variables belong to few components.
    one_of_each = {id(variable.parent_component()): variable for variable in variables}
    return next((variable for variable in one_of_each.values() if _is_of_another(own, variable)), None)


def _is_of_another(own: Any, variable: Any) -> bool:
    home = variable.parent_block()
    return home is not None and home.model() is not own


def foreign_read(variable: Any, own: Any) -> str:
    """What is wrong where a model reads a variable of another one, after the name of what reads it."""
    return (
        f"reads '{variable.parent_component().name}' of another model, '{variable.model().name}': whatever is stated "
        f"there does not hold in '{own.model().name}', where it would be any number."
    )
