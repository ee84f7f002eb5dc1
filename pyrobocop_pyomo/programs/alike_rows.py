"""Rows that are written alike, as those of one rule are: their linear terms are taken out of all of them at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import repeat
from operator import attrgetter, mul, neg, truediv
from typing import Any

from pyomo.core.expr.numeric_expr import ExternalFunctionExpression

from pyrobocop_pyomo.modeling.expression_nodes import CONSTANT, DIVISION, LEAF, NAMED, NEGATION, PRODUCT, SUMMATION

from .expression_codes import NodeKinds

# Fewer rows are taken apart one by one.
FEWEST_ALIKE = 8

_ARGUMENTS, _COUNT = attrgetter("_args_"), attrgetter("_nargs")


class AlikeRows:
    """Sums of terms, place by place: each place has one term of every row.

    Parameters
    ----------
    kinds : NodeKinds
    content_of : callable
        From a named expression to what it stands for.
    is_long_sum : callable
        Whether a factor has to be multiplied out.

    Attributes
    ----------
    leaves, parts : list of pairs
        Variables and parameters, and nonlinear summands, each place with the factors before them.
    constants : list of sequences of float
    """

    def __init__(self, kinds: NodeKinds, content_of: Callable[[Any], Any], is_long_sum: Callable[[Any], bool]) -> None:
        self._kind_of, self._content_of, self._is_long_sum = kinds.__getitem__, content_of, is_long_sum
        self.leaves: list[tuple[Sequence[Any], Sequence[float]]] = []
        self.parts: list[tuple[Sequence[Any], Sequence[float]]] = []
        self.constants: list[Sequence[float]] = []

    def split(self, nodes: Sequence[Any], scales: Sequence[float]) -> bool:
        """Take apart the expressions of all rows from one place, or return False where they are not written alike."""
        kind = self._kind(nodes)
        if kind is None:
            return False
        if kind == SUMMATION:
            count = _COUNT(nodes[0])
            if any(map(count.__ne__, map(_COUNT, nodes))):
                return False
            places = zip(*(node._args_[:count] for node in nodes), strict=True)
            return all(self.split(place, scales) for place in places)
        if kind == LEAF:
            self.leaves.append((nodes, scales))
        elif kind == CONSTANT:
            self.constants.append(list(map(mul, scales, map(float, nodes))))
        elif kind == NEGATION:
            return self.split([node._args_[0] for node in nodes], list(map(neg, scales)))
        elif kind == NAMED:
            if any(isinstance(node, ExternalFunctionExpression) for node in nodes):
                return False
            return self.split(list(map(self._content_of, nodes)), scales)
        elif kind in (PRODUCT, DIVISION):
            return self._split_factors(kind, nodes, scales)
        else:
            self.parts.append((nodes, scales))
        return True

    def _split_factors(self, kind: int, nodes: Sequence[Any], scales: Sequence[float]) -> bool:
        first, last = zip(*map(_ARGUMENTS, nodes), strict=True)
        kinds = self._kind(first), self._kind(last)
        if kind == PRODUCT:
            if kinds[0] == CONSTANT:
                return self.split(last, list(map(mul, scales, map(float, first))))
            if kinds[1] == CONSTANT:
                return self.split(first, list(map(mul, scales, map(float, last))))
            if any(map(self._is_long_sum, first)) or any(map(self._is_long_sum, last)):
                return False
        elif kinds[1] == CONSTANT:
            return all(last) and self.split(first, list(map(truediv, scales, map(float, last))))
        if None in kinds:
            return False  # a number here, none there
        self.parts.append((nodes, scales))
        return True

    def _kind(self, nodes: Sequence[Any]) -> int | None:
        """What all nodes are, or None."""
        kinds = list(map(self._kind_of, map(type, nodes)))
        return kinds[0] if kinds.count(kinds[0]) == len(kinds) else None


def split_alike(
    bodies: Sequence[Any], kinds: NodeKinds, content_of: Callable[[Any], Any], is_long_sum: Callable[[Any], bool]
) -> AlikeRows | None:
    """The terms of rows that are written alike and hold linear terms; None for any others."""
    rows = AlikeRows(kinds, content_of, is_long_sum)
    return rows if rows.split(bodies, list(repeat(1.0, len(bodies)))) and rows.leaves else None
