"""Items lent to components while a rule is evaluated, and what the rule then reads."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import chain
from typing import Any

from pyomo.core.base.var import VarData

from .shared_nodes import variables_in

_MISSING = object()


@contextmanager
def in_place_of_nodes(variables: Iterable[tuple[Any, VarData]], index: float) -> Iterator[None]:
    """Context in which ``component[index]`` is another variable, on the grid or off it, however a rule gets there.

    A rule may hold the model in its closure, where no proxy can stand in its place.
    """
    replaced: list[tuple[dict[Any, Any], Any]] = []
    try:
        for component, variable in variables:
            # Pyomo has no public way to lend a component an item.
            items = component._data
            replaced.append((items, items.get(index, _MISSING)))
            items[index] = variable
        yield
    finally:
        for items, before in reversed(replaced):
            if before is _MISSING:
                del items[index]
            else:
                items[index] = before


def expressions_returned(result: Any) -> Iterator[Any]:
    """Expressions and relations in whatever a rule returned: also pairs, in lists, tuples and mappings."""
    if isinstance(result, Mapping):
        result = list(result.values())
    if isinstance(result, (list, tuple)):
        for each in result:
            yield from expressions_returned(each)
    elif hasattr(result, "is_expression_type"):
        yield result


def variables_read(result: Any) -> list[Any]:
    """Variables in whatever a rule returned, those of one expression after those of the one before."""
    return list(chain.from_iterable(map(variables_in, expressions_returned(result))))
