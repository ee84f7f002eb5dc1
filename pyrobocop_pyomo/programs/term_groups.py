"""Nonlinear terms of one shape each, with their variables and numbers in arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain
from typing import Any, NamedTuple, cast

from .batched_walk import Batch, BatchedWalk
from .expression_codes import CHOICE, NUMBER, POWER, SUM, Code
from .expression_kinds import CONSTANT, FUNCTION, LEAF, NAMED, SUMMATION, NodeKinds, comparison_name, function_name


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
        self,
        rows: list[int],
        scales: list[float],
        columns: Sequence[Sequence[int]],
        numbers: Sequence[Sequence[float]],
        parameters: Sequence[tuple[int, Sequence[int]]],
    ) -> None:
        """Add terms; variables, numbers and parameters come as one sequence over the terms for each of a term."""
        start, step = len(self.numbers), self.numbers_per_term
        self.rows += rows
        self.scales += scales
        self.columns += chain.from_iterable(zip(*columns, strict=True))
        self.numbers += chain.from_iterable(zip(*numbers, strict=True))
        for place, several in parameters:
            self.parameters += [(start + i * step + place, parameter) for i, parameter in enumerate(several)]


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

    def of(self, leaves: Sequence[Any]) -> list[int]:
        """Columns of many variables and parameters."""
        columns = list(map(self.column_of.get, map(id, leaves)))
        if None in columns:
            for i, leaf in enumerate(leaves):
                if columns[i] is None:
                    known = self.column_of.get(id(leaf))
                    columns[i] = self.add(leaf) if known is None else known
        return cast("list[int]", columns)


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

    def put(self, terms: Sequence[NonlinearTerm]) -> None:
        """Walk over the terms and put each into its group."""
        alike: dict[tuple[int | None, int], list[NonlinearTerm]] = {}
        for term in terms:
            alike.setdefault((term.symbol, len(term.nodes)), []).append(term)
        for (symbol, _), several in alike.items():
            self._put_alike(symbol, several)

    def _put_alike(self, symbol: int | None, terms: list[NonlinearTerm]) -> None:
        left = dict.fromkeys(range(len(terms)))
        first = Batch(
            items=range(len(terms)),
            pending=[list(nodes) for nodes in zip(*(reversed(term.nodes) for term in terms), strict=True)],
            code=[] if symbol is None else [symbol],
            numbers=[list(scales) for scales in zip(*(term.scales for term in terms), strict=True)],
        )
        for batch in BatchedWalk(self._kinds, self._columns.of, self._content_of).finished(first):
            self._group_of(tuple(batch.code), len(batch.columns), len(batch.numbers)).add(
                [terms[i].row for i in batch.items], [terms[i].scale for i in batch.items],
                batch.columns, batch.numbers, batch.parameters,
            )  # fmt: skip
            for i in batch.items:
                del left[i]
        for i in left:
            self._put_single(terms[i])

    def _group_of(self, code: Code, size: int, numbers_per_term: int) -> TermGroup:
        group = self.get(code)
        if group is None:
            group = self[code] = TermGroup(code, size, numbers_per_term)
        return group

    def _put_single(self, term: NonlinearTerm) -> None:
        """Walk over one term by itself and put it into its group."""
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
        self._group_of(tuple(code), len(columns), len(numbers)).add(
            [term.row], [term.scale], [[column] for column in columns], [[number] for number in numbers],
            [(place, [parameter]) for place, parameter in parameters],
        )  # fmt: skip
