"""Nonlinear terms of one shape each, with their variables and numbers in arrays.

A walk over one term after the other spends half a microsecond on each node, most of it on deciding what the node is.
`BatchedWalk` goes over thousands of terms at once, place by place of their trees, as long as they look the same: what a
node is, is decided once for a whole list of nodes that stand at the same place of their terms, and the lists are
handled by functions that loop in C. Where nodes of a list differ, the terms go on in separate batches.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from operator import attrgetter, eq, itemgetter
from typing import Any, NamedTuple, cast

import numpy as np
from pyomo.core.base.var import VarData

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

SMALLEST_BATCH = 8

_ARGUMENTS, _COUNT, _FIXED = attrgetter("_args_"), attrgetter("_nargs"), attrgetter("_fixed")


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
            self._add_free_variables([leaf for leaf, column in zip(leaves, columns, strict=True) if column is None])
            columns = list(map(self.column_of.get, map(id, leaves)))
        if None in columns:
            for i, leaf in enumerate(leaves):
                if columns[i] is None:
                    known = self.column_of.get(id(leaf))
                    columns[i] = self.add(leaf) if known is None else known
        return cast("list[int]", columns)

    def _add_free_variables(self, leaves: list[Any]) -> None:
        """Add the leaves, where all of them are free variables as Pyomo makes them."""
        classes: set[Any] = set(map(type, leaves))
        if any(not issubclass(cls, VarData) or cls.fixed is not VarData.fixed for cls in classes):
            return
        new = {id(leaf): leaf for leaf in leaves}
        if not any(map(_FIXED, new.values())):
            self.column_of.update(zip(new, range(len(self.variables), len(self.variables) + len(new)), strict=True))
            self.variables += new.values()


class NonlinearTerm(NamedTuple):
    """A nonlinear term of a row: ``scale`` times its nodes under an operator, or times its only node."""

    row: int
    scale: float
    nodes: tuple[Any, ...]
    symbol: int | None
    scales: tuple[float, ...]


@dataclass(eq=False)
class Batch:
    """Terms that have the same code as far as the walk has come.

    Attributes
    ----------
    items : list of int
        Which terms.
    pending : list of sequences
        Nodes still to be visited: each a sequence with one node for each term.
    code : list
        See `expression_codes`.
    columns, numbers : list of sequences
        Variables and numbers met so far: each a sequence with one for each term.
    parameters : list of pairs
        Places in `numbers`, and a sequence with the parameter that each term has there.
    """

    items: Sequence[int]
    pending: list[Sequence[Any]]
    code: list[Any]
    columns: list[Sequence[int]] = field(default_factory=list)
    numbers: list[Sequence[float]] = field(default_factory=list)
    parameters: list[tuple[int, Sequence[int]]] = field(default_factory=list)
    places: dict[int, tuple[int, list[int]]] = field(default_factory=dict)

    def part(self, chosen: list[int]) -> Batch:
        """The same state for some of the terms."""

        def pick(values: Sequence[Any]) -> Sequence[Any]:
            return [values[i] for i in chosen]

        return Batch(
            items=pick(self.items),
            pending=[pick(nodes) for nodes in self.pending],
            code=list(self.code),
            columns=[pick(columns) for columns in self.columns],
            numbers=[pick(numbers) for numbers in self.numbers],
            parameters=[(place, pick(parameters)) for place, parameters in self.parameters],
            places={ids[chosen[0]]: (place, list(pick(ids))) for place, ids in self.places.values()},
        )


class BatchedWalk:
    """Turns terms into codes, batch by batch.

    Parameters
    ----------
    kinds : NodeKinds
    column_of : callable
        From the variables and parameters of a list to their columns; see `Columns`.
    content_of : callable
        From a named expression to what it stands for.
    """

    def __init__(
        self, kinds: NodeKinds, column_of: Callable[[Sequence[Any]], list[int]], content_of: Callable[[Any], Any]
    ) -> None:
        self._kind_of, self._columns_of, self._content_of = kinds.__getitem__, column_of, content_of

    def finished(self, first: Batch) -> Iterator[Batch]:
        """Walk to the ends of all terms of a batch; those that stay in batches too small are left out."""
        batches = [first]
        while batches:
            batch = batches.pop()
            if len(batch.items) < SMALLEST_BATCH:
                continue
            differing = self._walk(batch)
            if differing is None:
                yield from _with_different_variables(batch)
                continue
            positions = defaultdict(list)
            for i, key in enumerate(differing):
                positions[key].append(i)
            batches += [batch.part(chosen) for chosen in positions.values() if len(chosen) >= SMALLEST_BATCH]

    def _walk(self, batch: Batch) -> Sequence[Hashable] | None:
        """Walk as far as all terms agree; returns what differs, with the nodes still pending, or None at the end."""
        pending, code = batch.pending, batch.code
        while pending:
            nodes = pending[-1]
            kinds = list(map(self._kind_of, map(type, nodes)))
            kind = kinds[0]
            if kinds.count(kind) != len(kinds):
                return kinds
            if kind == LEAF:
                differing = self._visit_leaves(batch, nodes)
                if differing is not None:
                    return differing
                continue
            if kind == CONSTANT:
                code.append(NUMBER)
                batch.numbers.append(nodes)
                pending.pop()
                continue
            if kind == NAMED:
                pending[-1] = list(map(self._content_of, nodes))
                continue
            identities = list(map(id, nodes))
            known = batch.places.get(identities[0])
            if known is not None:
                if known[1] != identities:
                    return list(map(eq, known[1], identities))
                code.append(("same", known[0]))
                pending.pop()
                continue
            arguments = list(map(_ARGUMENTS, nodes))
            symbols = self._symbols(kind, nodes, arguments)
            if symbols is not None and symbols.count(symbols[0]) != len(symbols):
                return symbols
            batch.places[identities[0]] = len(code), identities
            code.append(kind if symbols is None or symbols[0] is None else symbols[0])
            pending.pop()
            columns = list(zip(*arguments, strict=False))
            if kind == SUMMATION:
                columns = columns[: symbols[0] - SUM]  # type: ignore[index]
            elif isinstance(code[-1], tuple):
                columns = columns[:1]
            pending += reversed(columns)
        return None

    def _symbols(self, kind: int, nodes: Sequence[Any], arguments: list[Any]) -> list[Any] | None:
        """Symbols of operators, where their kind does not say it all; None for an operator that is its kind."""
        if kind == SUMMATION:
            return [SUM + count for count in map(_COUNT, nodes)]
        if kind == POWER:
            exponents = list(map(itemgetter(1), arguments))
            return [
                ("**", exponent) if self._kind_of(exponent.__class__) == CONSTANT else None for exponent in exponents
            ]
        if kind <= CHOICE:
            return None
        return list(map(function_name if kind == FUNCTION else comparison_name, nodes))

    def _visit_leaves(self, batch: Batch, leaves: Sequence[Any]) -> Sequence[Hashable] | None:
        columns = self._columns_of(leaves)
        if max(columns) < 0:
            batch.code.append(NUMBER)
            batch.parameters.append((len(batch.numbers), [-1 - column for column in columns]))
            batch.numbers.append([0.0] * len(columns))
        elif min(columns) < 0:
            return [column < 0 for column in columns]
        else:
            first = columns[0]
            number = next((j for j, known in enumerate(batch.columns) if known[0] == first), len(batch.columns))
            if number == len(batch.columns):
                batch.columns.append(columns)
            elif columns != batch.columns[number]:
                return list(map(eq, columns, batch.columns[number]))
            batch.code.append(-1 - number)
        batch.pending.pop()
        return None


def _with_different_variables(batch: Batch) -> Iterator[Batch]:
    """Leave out terms in which two variables are one: the first term of the batch did not show it."""
    if len(batch.columns) > 1:
        ordered = np.sort(np.array(batch.columns), axis=0)
        different = (ordered[1:] != ordered[:-1]).all(axis=0)
        if not different.all():
            chosen = np.flatnonzero(different).tolist()
            if chosen:
                yield batch.part(chosen)
            return
    yield batch


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
