"""Start and end values that contradict the equations, and rows that are decided already."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.var import Var
from pyomo.core.expr.visitor import identify_variables

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.row_violations import relation_violation
from pyrobocop_pyomo.phases import Parameter
from pyrobocop_pyomo.phases.horizon import real_grid
from pyrobocop_pyomo.phases.point_model import PointModel
from pyrobocop_pyomo.phases.rule_results import labelled_rows

from .findings import Finding, Severity, Subject
from .linearisation import residual_of

TOLERANCE = 1e-6


def boundary_findings(phase: Any, remarks: list[str]) -> Iterator[Finding]:
    """Fixed start or end values that violate what is stated about states alone."""
    record = phase.record
    for time, where in ((record.grid.times[0], "initial"), (record.grid.times[-1], "final")):
        fixed = {name: phase.component(name)[time] for name in record.names_of_states}
        values = {name: data.value for name, data in fixed.items() if data.fixed}
        parameters = {name: phase.component(name) for name in record.names(Parameter)}
        values.update((name, data.value) for name, data in parameters.items() if data.fixed)
        if not values:
            continue
        try:
            point = PointModel(phase, record, record.grid, real_grid(phase, record))
        except (TrajectoryError, ValueError, TypeError):
            return  # the horizon has no values yet
        point.set_values(values)
        for statement in record.statements:
            if statement.kind not in ("residual", "constraint"):
                continue
            try:
                answer = point.result_of(statement, time)
            except Exception as error:  # a rule was written for its points only: anything may come out elsewhere
                remarks.append(f"'{statement.name}' of phase '{phase.name}' at t = {time:g} ({error})")
                continue
            for label, row in labelled_rows(statement.kind, answer).items():
                gap = relation_violation(row, unknown=0.0)
                if gap > TOLERANCE:
                    name = statement.name if label is None else f"{statement.name}[{label}]"
                    yield Finding(
                        Severity.ERROR,
                        Subject.START,
                        f"phase '{phase.name}': the {where} values violate {statement.kind} '{name}' by {gap:.3g} at "
                        f"t = {time:g}: {', '.join(f'{key} = {number:g}' for key, number in values.items())}.",
                        (f"{phase.name}.{statement.name}",),
                        f"Give {where} values that satisfy it, or leave one of them free.",
                        time,
                    )


def decided_findings(block: Any) -> Iterator[Finding]:
    """Rows without a variable that may move, which do not hold; fixed values outside their bounds."""
    for row in block.component_data_objects(Constraint, active=True, descend_into=Block):
        if next(identify_variables(row.body, include_fixed=False), None) is None and abs(residual_of(row)) > TOLERANCE:
            yield Finding(
                Severity.ERROR,
                Subject.CONTRADICTION,
                f"'{row.name}' holds no variable that may move and is violated by {abs(residual_of(row)):.3g}.",
                (row.name,),
                "Unfix a variable in it, or correct the fixed values.",
            )
    for data in block.component_data_objects(Var, active=True, descend_into=Block):
        lower, upper = data.bounds
        if data.fixed and data.value is not None:
            below = lower is not None and data.value < lower - TOLERANCE
            above = upper is not None and data.value > upper + TOLERANCE
            if below or above:
                yield Finding(
                    Severity.ERROR,
                    Subject.CONTRADICTION,
                    f"'{data.name}' is fixed to {data.value:g}, outside its bounds ({lower}, {upper}).",
                    (data.name,),
                    "Change the value or widen the bounds.",
                )
        elif lower is not None and upper is not None and lower > upper:
            yield Finding(
                Severity.ERROR,
                Subject.CONTRADICTION,
                f"'{data.name}' has the lower bound {lower:g} above the upper {upper:g}.",
                (data.name,),
                "Swap or widen them.",
            )
