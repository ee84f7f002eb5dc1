"""Rows that give a derivative: a number times it, plus something without derivatives."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.expr.numeric_expr import DivisionExpression, NegationExpression, ProductExpression, SumExpression

from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any


def explicit_rates(rates: dict[str, Any], rows: list[Any]) -> dict[str, tuple[int, Any]]:
    """By state: which of the rows gives its derivative, and as what.

    Parameters
    ----------
    rates : dict of str to variable
        The derivative of each state in the rows.
    rows : list of expressions
    """
    names = {id(rate): name for name, rate in rates.items()}
    given: dict[str, tuple[int, Any]] = {}
    for i, row in enumerate(rows):
        summands = list(_summands(row))
        of_rates = [(factor, names[id(node)]) for factor, node in summands if factor and id(node) in names]
        others = [(factor, node) for factor, node in summands if id(node) not in names]
        if len(of_rates) == 1 and names.keys().isdisjoint(variables_in_any(node for _, node in others)):
            of_rate, name = of_rates[0]
            given.setdefault(name, (i, sum(-factor / of_rate * node for factor, node in others)))
    return given


def _summands(row: Any) -> Iterator[tuple[float, Any]]:
    """What a row is the sum of, and the number in front of each."""
    pending = [(1.0, row)]
    while pending:
        factor, node = pending.pop()
        if isinstance(node, SumExpression):
            pending += [(factor, part) for part in reversed(node.args)]
        elif isinstance(node, NegationExpression):
            pending.append((-factor, node.args[0]))
        elif isinstance(node, ProductExpression) and any(_is_number(part) for part in node.args):
            number, part = sorted(node.args, key=_is_number, reverse=True)
            pending.append((factor * number, part))
        elif isinstance(node, DivisionExpression) and _is_number(node.args[1]):
            pending.append((factor / node.args[1], node.args[0]))
        else:
            yield factor, node


def _is_number(node: Any) -> bool:
    return node.__class__ in native_numeric_types
