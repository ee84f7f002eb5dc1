"""Sums over the points that a continuous set happens to have: they would be incomplete once it has more.

Pyomo does not know that an expression was written as ``sum(... for t in m.t)``. Where there is a rule, it is run again
after the set has grown, and the variables are compared. Where there is only an expression, it is taken for a sum over
the set when one term is repeated at all of its points, or at all but the first or the last.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from pyomo.core.base.constraint import Constraint, ConstraintList
from pyomo.core.base.expression import Expression
from pyomo.core.base.initializer import ConstantInitializer
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var
from pyomo.core.expr import MonomialTermExpression, NegationExpression, ProductExpression, SumExpression
from pyomo.core.expr.numvalue import value
from pyomo.dae import DerivativeVar, Integral

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.failures import failures_as
from pyrobocop_pyomo.modeling.shared_nodes import NodesOnce, variables_in, variables_in_any, variables_read

from .structure import Spot, axis_on

_WITH_COEFFICIENTS = (ProductExpression, MonomialTermExpression, NegationExpression)


def check_possible_sum(component: Any, index: Any, domain: Any) -> None:
    """Raise a `ModelError` when the rule of an expression now reads more than it holds."""
    where = (
        f"'{component.name}': holds variables at several points of '{domain.name}', and its rule fails now that the "
        "set has more"
    )
    with failures_as(ModelError, where):
        result = component._rule(component.parent_block(), index)
    if set(map(id, variables_read(result))) - variables_in_any([component[index].expr]).keys():
        raise _refusal(component, index, domain)


def find_possible_sums(spots: list[Spot], domain: Any) -> list[tuple[Any, Any]]:
    """Component and index of the expressions to check again after the set has grown.

    Raises
    ------
    ModelError
        When an expression without a rule looks like a sum over the set.
    """
    points = tuple(domain)
    place = {
        id(data): (family, time)
        for spot in spots
        if spot.component.ctype in (Var, DerivativeVar, Expression)
        for family, time, data in spot.members_along(domain)
    }
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
            read = map(id, variables_in(data.expr, leaves))
            times = {place[variable][1] for variable in read if variable in place}
            if len(times | own) < 2:
                continue
            if _can_be_asked(spot.component):
                possible_sums.append((spot.component, index))
                continue
            terms = _Terms(place, leaves)
            terms.of(data.expr)
            if _covers(terms.repeated, points):
                raise _refusal(spot.component, index, domain)
    return possible_sums


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


class _Terms(NodesOnce):
    """Finds times at which the same term is repeated in one sum: the trace of a sum over a set.

    Terms are the same when they differ in times, and in the size of numbers, only. What is found at an expression is
    its form, whether a number below zero stands before it, and its times.

    Parameters
    ----------
    place : mapping of the id of a variable to (family, time)
    leaves : collection of int
        Ids of named expressions that are not looked into.

    Attributes
    ----------
    repeated : set of float
    """

    def __init__(self, place: Mapping[int, tuple[Any, float]], leaves: Collection[int]) -> None:
        super().__init__()
        self._place, self._leaves = place, leaves
        self.repeated: set[float] = set()

    def goes_below(self, node: Any) -> bool:
        return super().goes_below(node) and node.is_potentially_variable() and id(node) not in self._leaves

    def of_leaf(self, leaf: Any) -> Any:
        if not leaf.is_potentially_variable():
            return value(leaf, exception=False) or 0
        family, time = self._place.get(id(leaf), (id(leaf), None))
        return family, False, frozenset(() if time is None else (time,))

    def of_operation(self, node: Any, found: list[Any]) -> Any:
        parts = [each for each in found if each.__class__ is tuple]
        if isinstance(node, SumExpression):
            times_of: dict[Any, set[frozenset[float]]] = {}
            for *form, times in parts:
                if times:
                    times_of.setdefault(tuple(form), set()).add(times)
            self.repeated.update(*(times for of in times_of.values() if len(of) > 1 for times in of))
        if len(parts) == 1 and (node.is_named_expression_type() or isinstance(node, _WITH_COEFFICIENTS)):
            ((form, is_negative, times),) = parts
            negations = sum(1 for each in found if each.__class__ is not tuple and each < 0)
            negations += isinstance(node, NegationExpression)
            return form, is_negative ^ (negations % 2 == 1), times
        return (type(node), *(part[:2] for part in parts)), False, frozenset().union(*(part[2] for part in parts))
