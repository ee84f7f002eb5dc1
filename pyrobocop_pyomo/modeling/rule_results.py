"""The expressions and variables in whatever a rule returned."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any

from .shared_nodes import variables_in


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
