"""`Column`: one operand for each of many points, so that expressions of all of them are made node by node.

Pyomo's operators look up what two operands give, and take most of the time in which rows are stated. Where the operands
of all points are alike, one look-up tells the node of each.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Sequence
from itertools import repeat
from typing import Any

from pyomo.common.numeric_types import native_types
from pyomo.core.expr import EqualityExpression

from .expression_nodes import DIVISION, FUNCTION, LEAF, NEGATION, POWER, PRODUCT, SUMMATION, kind_of_node

_OPERANDS = {LEAF, PRODUCT, DIVISION, NEGATION, POWER, SUMMATION, FUNCTION}


class Column:
    """Operands, one for each point; what operators and functions make of it are columns again.

    Parameters
    ----------
    entries : sequence
        Variables, parameters, expressions or numbers.
    """

    __slots__ = ("entries",)
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, entries: Sequence[Any]) -> None:
        self.entries = entries


def over_points(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of expressions that takes columns as well, among numbers that are the same at all points."""

    def applied(*operands: Any) -> Any:
        if not any(operand.__class__ is Column for operand in operands):
            return function(*operands)
        given = [operand.entries if operand.__class__ is Column else repeat(operand) for operand in operands]
        first = [next(iter(entries)) for entries in given]
        node = function(*first)
        arguments = _arguments(node, first, given)
        if arguments is None:
            return Column(list(map(function, *given)))
        is_function = kind_of_node(node.__class__) == FUNCTION
        make = node.create_node_with_local_data if is_function else node.__class__
        return Column(list(map(make, zip(*arguments, strict=False))))

    return applied


def _arguments(node: Any, first: Sequence[Any], given: Sequence[Iterable[Any]]) -> list[Iterable[Any]] | None:
    """The arguments of the nodes of all points; None where the node of the first does not tell the others."""
    if node.__class__ is not EqualityExpression and kind_of_node(node.__class__) not in _OPERANDS - {LEAF}:
        return None
    if len(set(map(id, first))) < len(first):
        return None
    columns = [entries for entries in given if not isinstance(entries, repeat)]
    for entries in columns:
        classes = set(map(type, entries))
        if len(classes) > 1 or kind_of_node(classes.pop()) not in _OPERANDS:
            return None
    arguments: list[Iterable[Any]] = []
    for argument in node.args:
        place = next((i for i, operand in enumerate(first) if operand is argument), None)
        if place is not None:
            arguments.append(given[place])
        elif argument.__class__ in native_types:
            arguments.append(repeat(argument))  # of a number that is the same at all points
        else:
            return None
    return arguments if all(any(entries is held for held in arguments) for entries in columns) else None


def _with_operators(column: type[Column]) -> None:
    for name in ("add", "sub", "mul", "truediv", "pow", "neg", "eq", "le", "lt"):
        applied = over_points(getattr(operator, name))
        setattr(column, f"__{name}__", applied)
        if name in ("add", "sub", "mul", "truediv", "pow"):
            setattr(column, f"__r{name}__", lambda self, other, applied=applied: applied(other, self))


_with_operators(Column)
