"""What bounds and fixed variables say about a pair before anything is solved: a positive side makes the other zero."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import LiftedPair, SidePart, SideVariable
from pyrobocop_pyomo.diagnosis.values import SIDES_HOLD
from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.expression_bounds import ExpressionBounds


@dataclass(frozen=True, eq=False)
class Decision:
    """A side that has to be zero, because the other one cannot.

    Attributes
    ----------
    pair : LiftedPair
    side : SideVariable
        The one to hold at zero.
    other_least : float
        Smallest value of the other one.
    """

    pair: LiftedPair
    side: SideVariable
    other_least: float


def presolve(pairs: Sequence[LiftedPair], tolerance: float = 1e-7) -> list[Decision]:
    """Find the pairs that bounds and fixed variables decide.

    Parameters
    ----------
    pairs : list of LiftedPair
    tolerance : float
        A side counts as positive from here on, and a fixed one as negative below ``-tolerance``.

    Returns
    -------
    list of Decision
        In the order of the pairs.

    Raises
    ------
    ComplementarityError
        Where a side has a fixed value and both are positive, or one of them cannot reach zero from below: the pair
        cannot be met.
    """
    intervals = ExpressionBounds()
    found = []
    for pair in pairs:
        least_a, most_a = _range(pair.a, pair.pair.a, pair.pair.a_part, intervals)
        least_b, most_b = _range(pair.b, pair.pair.b, pair.pair.b_part, intervals)
        for which, most in (("first", most_a), ("second", most_b)):
            if most < -tolerance:
                raise ComplementarityError(
                    f"'{pair.pair.name}': its {which} side is at most {most:g} by bounds and fixed variables, but must "
                    f"be >= 0. Check the bounds and what is fixed. {SIDES_HOLD}"
                )
        if least_a > tolerance and least_b > tolerance:
            if not (_is_fixed(pair.a) or _is_fixed(pair.b)):
                continue  # bounds alone: a problem without a solution, which the solve says
            raise ComplementarityError(
                f"'{pair.pair.name}': both sides are positive by bounds and fixed variables (at least {least_a:g} and "
                f"{least_b:g}), but one has to be zero. Check the bounds and what is fixed."
            )
        if least_a > tolerance:
            found.append(Decision(pair, pair.b, least_a))
        elif least_b > tolerance:
            found.append(Decision(pair, pair.a, least_b))
    return found


@contextmanager
def fixed_at_zero(decisions: Sequence[Decision]) -> Iterator[None]:
    """Hold the decided sides at zero by the bounds of their variables; afterwards these are as they were."""
    # The stored bound and not `variable.upper`, which cannot tell a bound of its own from one of the domain.
    before: list[tuple[Any, str, Any]] = []
    try:
        for decision in decisions:
            variable, offset = decision.side.variable, value(decision.side.offset)
            if variable.fixed:
                continue
            # Intersected and not overwritten: a bound that excludes zero stays, and the solver sees it.
            if decision.side.sign > 0:
                before.append((variable, "_ub", variable._ub))
                variable.setub(offset if variable.ub is None else min(offset, variable.ub))
            else:
                before.append((variable, "_lb", variable._lb))
                variable.setlb(offset if variable.lb is None else max(offset, variable.lb))
        yield
    finally:
        for variable, name, bound in reversed(before):
            setattr(variable, name, bound)


def _is_fixed(side: SideVariable) -> bool:
    return bool(side.variable.fixed)


def _range(side: SideVariable, expression: Any, part: SidePart, intervals: ExpressionBounds) -> tuple[float, float]:
    """Interval that a side lies in, by its variable and, where it was lifted, by its expression."""
    variable, offset = side.variable, value(side.offset)
    if variable.fixed:
        ends = [side.sign * (variable.value - offset)] * 2
    else:
        lower = -float("inf") if variable.lb is None else variable.lb
        upper = float("inf") if variable.ub is None else variable.ub
        ends = [side.sign * (lower - offset), side.sign * (upper - offset)]
    least, most = min(ends), max(ends)
    if expression is not variable:
        below, above = intervals.walk_expression(expression)
        if part is SidePart.NEGATIVE:
            below, above = -above, -below
        if part is not SidePart.WHOLE:
            below, above = max(below, 0.0), max(above, 0.0)
        least, most = max(least, below), min(most, above)
    return least, most
