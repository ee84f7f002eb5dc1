"""A walk over thousands of terms at once, place by place of their trees, as long as they look the same.

A walk over one term after the other spends half a microsecond on each node, most of it on deciding what the node is.
Here that is decided once for a whole list of nodes that stand at the same place of their terms; the lists are handled
by functions that loop in C. Where nodes of a list differ, the terms go on in separate batches.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from operator import attrgetter, eq, itemgetter
from typing import Any

import numpy as np

from .expression_codes import CHOICE, NUMBER, POWER, SUM
from .expression_kinds import CONSTANT, FUNCTION, LEAF, NAMED, SUMMATION, NodeKinds, comparison_name, function_name

SMALLEST_BATCH = 8

_ARGUMENTS, _COUNT = attrgetter("_args_"), attrgetter("_nargs")


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
        self,
        kinds: NodeKinds,
        column_of: Callable[[Sequence[Any]], list[int]],
        content_of: Callable[[Any], Any],
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
