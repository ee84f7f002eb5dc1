"""Sums over the points that a continuous set happens to have: they would be incomplete once it has more.

Pyomo does not know that an expression was written as ``sum(... for t in m.t)``. Where there is a rule, it is run again
after the set has grown, and the variables are compared. Where there is only an expression, it is taken for a sum over
the set when one term is repeated at all of its points, or at all but the first or the last.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pyomo.core.base.constraint import Constraint, ConstraintList
from pyomo.core.base.expression import Expression
from pyomo.core.base.initializer import ConstantInitializer
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var
from pyomo.core.expr import MonomialTermExpression, NegationExpression, ProductExpression, SumExpression
from pyomo.core.expr.numvalue import native_types, value
from pyomo.dae import DerivativeVar, Integral

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.failures import failures_as
from pyrobocop_pyomo.modeling.shared_nodes import variables_in

from .structure import Spot, axis_on


@dataclass(frozen=True)
class PossibleSum:
    """An expression at several points of the set whose rule can be run again."""

    component: Any
    index: Any
    variables: frozenset[int]
    leaves: frozenset[int]

    def check(self, domain: Any) -> None:
        """Raise a `ModelError` when the rule now says something else."""
        where = (
            f"'{self.component.name}': holds variables at several points of '{domain.name}', and its rule fails now "
            "that the set has more"
        )
        with failures_as(ModelError, where):
            result = self.component._rule(self.component.parent_block(), self.index)
        parts = result if isinstance(result, (tuple, list)) else (result,)
        parts = [part for part in parts if part.__class__ in native_types or hasattr(part, "is_expression_type")]
        if {id(variable) for part in parts for variable in variables_in(part, self.leaves)} - self.variables:
            raise _refusal(self.component, self.index, domain)


def find_possible_sums(spots: list[Spot], domain: Any) -> list[PossibleSum]:
    """The expressions to check again after the set has grown.

    Raises
    ------
    ModelError
        When an expression without a rule looks like a sum over the set.
    """
    points = tuple(domain)
    place = dict(_places(spots, domain))
    # Named expressions are checked by themselves.
    named = [spot.component for spot in spots if spot.component.ctype in (Integral, Expression)]
    leaves = frozenset(id(data) for component in named for data in component.values())
    possible_sums = []
    for spot in spots:
        if spot.component.ctype not in (Objective, Constraint, Expression) or isinstance(spot.component, Integral):
            continue
        if spot.component.is_reference():
            continue
        axis = axis_on(spot.component, domain)
        around = {time for outer, time in spot.outer if outer is domain}
        for index, data in spot.component.items():
            own = around if axis is None else {axis.time(index)}
            variables = list(variables_in(data.expr, leaves))
            times = {place[id(variable)][1] for variable in variables if id(variable) in place}
            if len(times | own) < 2:
                continue
            if _can_be_asked(spot.component):
                possible_sums.append(PossibleSum(spot.component, index, frozenset(map(id, variables)), leaves))
            elif _covers(repeated_times(data.expr, place, leaves), points):
                raise _refusal(spot.component, index, domain)
    return possible_sums


def _places(spots: list[Spot], domain: Any) -> Iterator[tuple[int, tuple[Any, float]]]:
    for spot in spots:
        if spot.component.ctype not in (Var, DerivativeVar, Expression):
            continue
        for family, time, data in spot.members_along(domain):
            yield id(data), (family, time)


def _can_be_asked(component: Any) -> bool:
    if isinstance(component, ConstraintList) or component._rule is None:
        return False
    return not isinstance(component._rule, ConstantInitializer) and not component._rule.contains_indices()


def _covers(times: set[float], points: tuple[float, ...]) -> bool:
    return len(times) > 1 and times >= min(set(points[1:]), set(points[:-1]), key=lambda inner: len(inner - times))


def _refusal(component: Any, index: Any, domain: Any) -> ModelError:
    where = "" if index is None else f"[{index}]"
    return ModelError(
        f"'{component.name}{where}': is a sum over the points that '{domain.name}' had when it was written, "
        "and would miss all others. For an integral over time write an Integral; for a sum over the final "
        "mesh build it after the transformation; for a sum over chosen points, such as times of measurements, give "
        "it a function, rule=..., that sums over those."
    )


def repeated_times(expression: Any, place: Mapping[int, tuple[Any, float]], leaves: Collection[int]) -> set[float]:
    """Times at which the same term is repeated in one sum: the trace of a sum over a set.

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
        """The form of a term up to times and coefficients, None for a number; and its times."""
        if part.__class__ in native_types or not part.is_potentially_variable():
            return None, frozenset()
        if id(part) in self._leaves or not part.is_expression_type():
            family, time = self._place.get(id(part), (id(part), None))
            return family, frozenset() if time is None else frozenset([time])
        read = [self.read(argument) for argument in part.args]
        times = frozenset().union(*(found for _, found in read))
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
        numbers = [
            argument
            for argument in part.args
            if argument.__class__ in native_types or not argument.is_potentially_variable()
        ]
        return any((value(argument, exception=False) or 0) < 0 for argument in numbers)
