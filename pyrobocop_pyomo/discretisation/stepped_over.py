"""Path constraints that hold at the points of the mesh and not between them: a thin obstacle, a pole."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.expr.numeric_expr import NegationExpression, SumExpression

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.phases.bounds_between_points import lowest_value, sides_stated
from pyrobocop_pyomo.phases.phase_values import PhaseValues
from pyrobocop_pyomo.phases.record import Statement
from pyrobocop_pyomo.phases.rule_formulas import RuleFormulas

from .estimates import SMALL_MOTION_ERROR


def stepped_over(phase: Any) -> Iterator[tuple[str, float, float]]:
    """Path constraints that are missed between the points by more than a hundredth of their limit: name, amount, time.

    Where a rule gives no formula, or one of which no bounds are known, nothing is said.

    Parameters
    ----------
    phase : PhaseBlock
        With a solution.
    """
    record = phase.record
    if record.discrete_states or not record.statements_of("constraint"):
        return
    trajectory = PhaseValues(phase).trajectory(evaluate=False)
    formulas = RuleFormulas(phase, trajectory.grid)
    for statement in record.statements_of("constraint"):
        try:
            slacks = list(_slacks(formulas, statement))
        except TrajectoryError:
            continue
        for slack in slacks:
            allowed = -SMALL_MOTION_ERROR * _limit(slack)
            lowest, time = lowest_value(slack, allowed, formulas, trajectory)
            if lowest < allowed:
                yield statement.name, -lowest, time


def _slacks(formulas: RuleFormulas, statement: Statement) -> Iterator[Any]:
    """What each inequality of a rule has left: the larger less the smaller side."""
    for body, lower, upper in sides_stated(formulas, statement).values():
        if lower is upper:
            continue  # an equality
        for smaller, larger in ((lower, body), (body, upper)):
            is_limit = not any(side.__class__ is float and math.isinf(side) for side in (smaller, larger))
            if is_limit and hasattr(slack := larger - smaller, "is_expression_type"):
                yield slack


def _limit(slack: Any) -> float:
    """The number that a formula is compared with, as far as it stands in its sum; 1 without any."""
    sums, numbers = [slack], [0.0]
    while sums:
        of = sums.pop()
        for part in of.args if of.is_expression_type() else ():
            if part.__class__ in native_numeric_types:
                numbers.append(float(part))
            elif isinstance(part, (SumExpression, NegationExpression)):
                sums.append(part)
    return max(map(abs, numbers)) or 1.0
