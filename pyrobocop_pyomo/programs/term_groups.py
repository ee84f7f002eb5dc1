"""Nonlinear terms of one shape each, with their variables and numbers in arrays, from one walk over each term."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from pyrobocop_pyomo.modeling.expression_nodes import (
    CHOICE,
    CONSTANT,
    FUNCTION,
    LEAF,
    NAMED,
    POWER,
    SUMMATION,
    comparison_name,
)

from .expression_codes import NUMBER, SUM, Code, NodeKinds, function_name


class TermGroup:
    """Nonlinear terms of one shape: ``scales[i] * term(variables[i], numbers[i])`` is added to row ``rows[i]``.

    Attributes
    ----------
    code : tuple
        The shape; see `expression_codes`.
    size, numbers_per_term : int
        Counts of variables and of numbers in one term.
    rows : list of int
    scales : list of float
    columns : list of int
        Variables, `size` for each term.
    numbers : list of float
        Numbers, `numbers_per_term` for each term; 0 where a parameter stands.
    parameters : list of pairs of int
        Places in `numbers` and the parameters that stand there.
    """

    __slots__ = ("code", "columns", "numbers", "numbers_per_term", "parameters", "rows", "scales", "size")

    def __init__(self, code: Code, size: int, numbers_per_term: int) -> None:
        self.code, self.size, self.numbers_per_term = code, size, numbers_per_term
        self.rows: list[int] = []
        self.scales: list[float] = []
        self.columns: list[int] = []
        self.numbers: list[float] = []
        self.parameters: list[tuple[int, int]] = []

    def add(
        self, row: int, scale: float, columns: Iterable[int], numbers: list[float], parameters: list[tuple[int, int]]
    ) -> None:
        """Add a term; a parameter comes with its place among the numbers of the term."""
        start = len(self.numbers)
        self.rows.append(row)
        self.scales.append(scale)
        self.columns += columns
        self.numbers += numbers
        self.parameters += [(start + place, parameter) for place, parameter in parameters]


class Columns:
    """Variables and parameters in the order in which a walk meets them.

    Attributes
    ----------
    variables : list of VarData
        Free variables.
    parameters : list
        Fixed variables and mutable Params: numbers that may change without a new walk.
    column_of : dict of id to int
        Place of a variable, or ``-1 - place`` of a parameter.
    """

    def __init__(self) -> None:
        self.variables: list[Any] = []
        self.parameters: list[Any] = []
        self.column_of: dict[int, int] = {}

    def add(self, leaf: Any) -> int:
        """Column of a variable or parameter that is met for the first time."""
        if leaf.is_variable_type() and not leaf.fixed:
            column = len(self.variables)
            self.variables.append(leaf)
        else:
            column = -1 - len(self.parameters)
            self.parameters.append(leaf)
        self.column_of[id(leaf)] = column
        return column

    def of(self, leaf: Any) -> int:
        """Column of a variable or parameter."""
        column = self.column_of.get(id(leaf))
        return self.add(leaf) if column is None else column


class NonlinearTerm(NamedTuple):
    """A nonlinear term of a row: ``scale`` times its nodes under an operator, or times its only node."""

    row: int
    scale: float
    nodes: tuple[Any, ...]
    symbol: int | None
    scales: tuple[float, ...]


class TermGroups(dict[Code, TermGroup]):
    """Groups by their codes.

    Parameters
    ----------
    columns : Columns
    kinds : NodeKinds
    content_of : callable
        From a named expression to what it stands for.
    """

    def __init__(self, columns: Columns, kinds: NodeKinds, content_of: Callable[[Any], Any]) -> None:
        super().__init__()
        self._columns, self._kinds, self._content_of = columns, kinds, content_of

    def put(self, term: NonlinearTerm) -> None:
        """Walk over a term and put it into its group."""
        nodes = list(reversed(term.nodes))
        code: list[Any] = [] if term.symbol is None else [term.symbol]
        numbers = list(term.scales)
        kinds, column_of = self._kinds, self._columns.column_of
        columns: dict[int, int] = {}  # to the numbers of the variables within this term
        parameters: list[tuple[int, int]] = []
        places: dict[int, int] = {}
        pop, put = nodes.pop, code.append
        while nodes:
            node = pop()
            kind = kinds[node.__class__]
            if kind == LEAF:
                column = column_of.get(id(node))
                if column is None:
                    column = self._columns.add(node)
                if column >= 0:
                    number = columns.get(column)
                    if number is None:
                        number = columns[column] = -1 - len(columns)
                    put(number)
                else:
                    put(NUMBER)
                    parameters.append((len(numbers), -1 - column))
                    numbers.append(0.0)
                continue
            if kind == CONSTANT:
                put(NUMBER)
                numbers.append(node)
                continue
            if kind == NAMED:
                nodes.append(self._content_of(node))
                continue
            identity = id(node)
            place = places.get(identity)
            if place is not None:
                # The same node again: a common subexpression, evaluated once, however often it is nested.
                put(("same", place))
                continue
            places[identity] = len(code)
            if kind == POWER and kinds[node._args_[1].__class__] == CONSTANT:
                put(("**", node._args_[1]))
                nodes.append(node._args_[0])
            elif kind <= CHOICE:
                put(kind)
                nodes += reversed(node._args_)
            elif kind == SUMMATION:
                put(SUM + node._nargs)
                nodes += reversed(node._args_[: node._nargs])
            elif kind == FUNCTION:
                put(function_name(node))
                nodes.append(node._args_[0])
            else:
                put(comparison_name(node))
                nodes += reversed(node._args_)
        key = tuple(code)
        group = self.get(key)
        if group is None:
            group = self[key] = TermGroup(key, len(columns), len(numbers))
        group.add(term.row, term.scale, columns, numbers, parameters)
