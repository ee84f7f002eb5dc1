"""Variables that belong to another model than the one that reads them: nothing of that model holds for them there."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

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
