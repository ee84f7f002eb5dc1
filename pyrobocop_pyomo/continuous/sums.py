"""Sums over the points that a continuous set happens to have: they would be incomplete once it has more.

Pyomo does not know that an expression was written as ``sum(... for t in m.t)``. Where there is a rule, it is run again
after the set has grown, and the variables are compared. Where there is only an expression, it is taken for a sum over
the set when one term is repeated at all of its points, or at all but the first or the last.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pyomo.core.base.constraint import Constraint, ConstraintList
from pyomo.core.base.expression import Expression
from pyomo.core.base.initializer import ConstantInitializer
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import native_types
from pyomo.dae import DerivativeVar, Integral

from pyrobocop_pyomo.errors import TranscriptionError

from .expressions import repeated_times, variables_in
from .structure import Spot, axes_of, axis_on


@dataclass(frozen=True)
class Suspect:
    """An expression at several points of the set whose rule can be run again."""

    component: Any
    index: Any
    variables: frozenset[int]
    leaves: frozenset[int]

    def check(self, domain: Any) -> None:
        """Raise a `TranscriptionError` when the rule now says something else."""
        try:
            answer = self.component._rule(self.component.parent_block(), self.index)
        except Exception as error:
            raise TranscriptionError(
                f"'{self.component.name}': holds variables at several points of '{domain.name}', and its rule fails "
                f"now that the set has more: {type(error).__name__}: {error}"
            ) from error
        parts = answer if isinstance(answer, (tuple, list)) else (answer,)
        parts = [part for part in parts if part.__class__ in native_types or hasattr(part, "is_expression_type")]
        if {id(each) for part in parts for each in variables_in(part, self.leaves)} - self.variables:
            raise _refusal(self.component, self.index, domain)


def find_suspects(spots: list[Spot], domain: Any) -> list[Suspect]:
    """What has to be looked at again after the set has grown.

    Raises
    ------
    TranscriptionError
        When an expression without a rule looks like a sum over the set.
    """
    points = tuple(domain)
    place = dict(_places(spots, domain))
    # Expressions of their own are looked at by themselves.
    named = [spot.component for spot in spots if spot.component.ctype in (Integral, Expression)]
    leaves = frozenset(id(data) for component in named for data in component.values())
    suspects = []
    for spot in spots:
        if spot.component.ctype not in (Objective, Constraint, Expression) or isinstance(spot.component, Integral):
            continue
        if spot.component.is_reference():
            continue
        axis = axis_on(spot.component, domain)
        around = {time for each, time in spot.outer if each is domain}
        for index, data in spot.component.items():
            own = around if axis is None else {axis.time(index)}
            variables = list(variables_in(data.expr, leaves))
            times = {place[id(each)][1] for each in variables if id(each) in place}
            if len(times | own) < 2:
                continue
            if _can_be_asked(spot.component):
                suspects.append(Suspect(spot.component, index, frozenset(map(id, variables)), leaves))
            elif _covers(repeated_times(data.expr, place, leaves), points):
                raise _refusal(spot.component, index, domain)
    return suspects


def _places(spots: list[Spot], domain: Any) -> Iterator[tuple[int, tuple[Any, float]]]:
    for spot in spots:
        if spot.component.ctype not in (Var, DerivativeVar, Expression):
            continue
        axes = axes_of(spot.component)
        for index, data in spot.component.items():
            for each, time in spot.points(index, axes):
                if each is domain:
                    yield id(data), (spot.family(index, axes, domain), time)


def _can_be_asked(component: Any) -> bool:
    if isinstance(component, ConstraintList) or component._rule is None:
        return False
    return not isinstance(component._rule, ConstantInitializer) and not component._rule.contains_indices()


def _covers(times: set[float], points: tuple[float, ...]) -> bool:
    return len(times) > 1 and times >= min(set(points[1:]), set(points[:-1]), key=lambda each: len(each - times))


def _refusal(component: Any, index: Any, domain: Any) -> TranscriptionError:
    where = "" if index is None else f"[{index}]"
    return TranscriptionError(
        f"'{component.name}{where}': is a sum over the points that '{domain.name}' had when it was written, "
        "and would miss all others. For an integral over time write an Integral; for a sum over the final "
        "mesh build it after the transformation; for a sum over chosen points, such as times of measurements, give "
        "it a function, rule=..., that sums over those."
    )
