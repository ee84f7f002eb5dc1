"""Reading expressions: which variables stand in them, and which are sums over the points of a set."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from pyomo.core.expr import MonomialTermExpression, NegationExpression, ProductExpression, SumExpression
from pyomo.core.expr.numvalue import native_types, value


def variables_in(expression: Any, leaves: Collection[int] = ()) -> Iterator[Any]:
    """Every variable of an expression, some perhaps more than once; a leaf, given by its id, stands for itself."""
    # Several times faster than Pyomo's general walker, and asked for every row of a model.
    stack, entered = [expression], set()
    while stack:
        part = stack.pop()
        if part.__class__ in native_types or part is None:
            continue
        if part.is_expression_type():
            if part.is_named_expression_type():
                if id(part) in entered:
                    continue
                entered.add(id(part))
                if id(part) in leaves:
                    yield part
                    continue
            stack.extend(part.args)
        elif part.is_variable_type():
            yield part


def repeated_times(expression: Any, place: Mapping[int, tuple[Any, float]], leaves: Collection[int]) -> set[float]:
    """Times at which the same term comes again and again in one sum: what a sum over a set looks like afterwards.

    Parameters
    ----------
    place : mapping of the id of a variable to (family, time)
        Terms are the same when they differ in times, and in the size of numbers, only.
    """
    reader = _Reader(place, leaves)
    reader.read(expression)
    return reader.repeated


class _Reader:
    def __init__(self, place: Mapping[int, tuple[Any, float]], leaves: Collection[int]) -> None:
        self._place, self._leaves = place, leaves
        self.repeated: set[float] = set()

    def read(self, part: Any) -> tuple[Any, frozenset[float]]:
        """What a term is up to times and sizes, None for a number; and its times."""
        if part.__class__ in native_types or not part.is_potentially_variable():
            return None, frozenset()
        if id(part) in self._leaves or not part.is_expression_type():
            family, time = self._place.get(id(part), (id(part), None))
            return family, frozenset() if time is None else frozenset([time])
        read = [self.read(each) for each in part.args]
        times = frozenset().union(*(each for _, each in read))
        terms = [term for term, _ in read if term is not None]
        if isinstance(part, SumExpression):
            self._compare(read)
        elif isinstance(part, (ProductExpression, MonomialTermExpression, NegationExpression)) and len(terms) == 1:
            return (("-", terms[0]) if self._negative(part) else terms[0]), times
        elif part.is_named_expression_type():
            return terms[0] if terms else None, times
        if len(terms) == 1 and isinstance(part, SumExpression):
            return terms[0], times
        return (type(part).__name__, tuple(term for term, _ in read)), times

    def _compare(self, read: list[tuple[Any, frozenset[float]]]) -> None:
        found: dict[Any, set[frozenset[float]]] = {}
        for term, times in read:
            if term is not None and times:
                found.setdefault(term, set()).add(times)
        for different in found.values():
            if len(different) > 1:
                self.repeated |= frozenset().union(*different)

    @staticmethod
    def _negative(part: Any) -> bool:
        if isinstance(part, NegationExpression):
            return True
        numbers = [each for each in part.args if each.__class__ in native_types or not each.is_potentially_variable()]
        return any((value(each, exception=False) or 0) < 0 for each in numbers)
