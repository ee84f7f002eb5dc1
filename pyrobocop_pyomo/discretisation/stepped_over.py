"""Path constraints that hold at the points of the mesh and not between them: a thin obstacle, a pole."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from typing import Any

from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.expr.numeric_expr import NegationExpression, SumExpression
from pyomo.core.expr.relational_expr import EqualityExpression, RelationalExpression

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.phases.bounds_between_points import lowest_value
from pyrobocop_pyomo.phases.companions import indices_of
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
    indices = indices_of(record, trajectory.grid)
    formulas = RuleFormulas(phase, record, indices, trajectory.grid)
    for statement in record.statements_of("constraint"):
        try:
            slacks = formulas.formulas_of(statement, partial(_slacks, statement))
        except TrajectoryError:
            continue
        for slack in slacks:
            allowed = -SMALL_MOTION_ERROR * _limit(slack)
            lowest, time = lowest_value(slack, allowed, formulas, trajectory, indices)
            if lowest < allowed:
                yield statement.name, -lowest, time


def _slacks(statement: Statement, result: Any) -> list[Any]:
    """What each inequality of a rule has left: the larger less the smaller side."""
    found = [
        after - before
        for row in statement.rows(result).values()
        for before, after in pairwise(_sides(row))
        if before is not None and after is not None
    ]
    return [slack for slack in found if hasattr(slack, "is_expression_type")]


def _sides(row: Any) -> tuple[Any, ...]:
    """The sides of an inequality, the smallest first; none of anything else."""
    if isinstance(row, tuple):
        return row if len(row) == 3 else ()
    is_inequality = isinstance(row, RelationalExpression) and not isinstance(row, EqualityExpression)
    return tuple(row.args) if is_inequality else ()


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
