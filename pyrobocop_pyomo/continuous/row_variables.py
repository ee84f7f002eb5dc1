"""Which variables rows hold, and which derivatives they say explicitly."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any, NamedTuple

from pyomo.core.expr import EqualityExpression

from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any


class RowVariables(NamedTuple):
    """What some rows hold.

    Attributes
    ----------
    given : dict of id to (row, expression)
        From a derivative that a row says explicitly, ``dx[t] == f``, to that row and ``f``.
    elsewhere : set of int
        Ids of all variables that the rows hold otherwise.
    """

    given: dict[int, tuple[Any, Any]]
    elsewhere: set[int]


def row_variables(rows: Iterable[Any], derivatives: Collection[int]) -> RowVariables:
    """Walk over rows, objectives or named expressions, all at once.

    Parameters
    ----------
    rows : iterable of component data
    derivatives : collection of int
        Ids of the variables that may be said explicitly.
    """
    given: dict[int, tuple[Any, Any]] = {}
    others: list[Any] = []
    for data in rows:
        expression = data.expr
        if isinstance(expression, EqualityExpression):
            left, right = expression.args
            if id(left) not in derivatives:
                left, right = right, left
            if id(left) in derivatives and id(left) not in given:
                given[id(left)] = (data, right)
                others.append(right)
                continue
        others.append(expression)
    return RowVariables(given, set(variables_in_any(others)))
