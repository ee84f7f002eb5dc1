"""Numbers at the initial guess: values that are not finite, boundary values that contradict equations, decided rows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.param import Param
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.row_violations import number_or_nan, relation_violation
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.undefined_values import undefined_part
from pyrobocop_pyomo.phases import Parameter
from pyrobocop_pyomo.phases.horizon import real_grid
from pyrobocop_pyomo.phases.point_model import PointModel
from pyrobocop_pyomo.phases.record import Statement, labelled_rows

from .findings import Finding, Severity, Subject
from .linearised_rows import LinearisedRows, gradient, residual_of

REMEDY = "Change the initial guess or the data, or keep the expression away from its edge by bounds."


def rate_findings(phase: Any) -> Iterator[Finding]:
    """Right-hand sides without a finite value at the initial guess, by the first time at which it shows."""
    for name, rates in phase.record.rates.items():
        wrong = [(time, number) for time, rate in rates.items() if not math.isfinite(number := number_or_nan(rate))]
        if wrong and not _waits_for_a_value(rates[wrong[0][0]]):
            time, number = wrong[0]
            rule = phase.record.equation_of[name]
            yield Finding(
                Severity.ERROR,
                Subject.DATA,
                f"phase '{phase.name}': the right-hand side of '{name}' in ode '{rule}' is {number:g} at t = {time:g}"
                f"{_and_more(len(wrong), 'point')}{_because(rates[time])}.",
                (f"{phase.name}.{name}",),
                REMEDY,
                time,
            )


def row_findings(linearised: LinearisedRows, reported: set[str]) -> Iterator[Finding]:
    """Rows without a finite value or derivative at the initial guess, one finding per component."""
    wrong: dict[str, list[Any]] = {}
    for row in linearised.rows:
        if not row.is_finite and not _waits_for_a_value(row.data.body):
            wrong.setdefault(row.data.parent_component().name, []).append(row)
    for name, rows in wrong.items():
        if name in reported:
            continue
        first = rows[0]
        if math.isfinite(first.residual):
            column = next(j for j, entry in first.gradient.items() if not math.isfinite(entry))
            what = f"has no finite derivative by '{linearised.variables[column].name}'"
        else:
            what = f"has the value {first.residual:g}"
        index = first.data.index()
        yield Finding(
            Severity.ERROR,
            Subject.DATA,
            f"'{first.data.name}' {what} at the initial guess{_and_more(len(rows), 'row')}{_because(first.data.body)}.",
            (name,),
            REMEDY,
            index if isinstance(index, float) else None,
        )


def data_findings(block: Any) -> Iterator[Finding]:
    """Objectives, parameters, bounds and initial guesses."""
    for objective in block.component_data_objects(Objective, active=True, descend_into=Block):
        entries = gradient(objective.expr, variables_in(objective.expr, include_fixed=False))
        number = number_or_nan(objective.expr)
        if not _waits_for_a_value(objective.expr):
            bad = next((v.name for v, entry in entries if not math.isfinite(entry)), None)
            if not math.isfinite(number) or bad is not None:
                what = f"has no finite derivative by '{bad}'" if math.isfinite(number) else f"is {number:g}"
                yield _error(
                    objective.name,
                    f"objective '{objective.name}' {what} at the initial guess{_because(objective.expr)}.",
                    REMEDY,
                )
    for component in block.component_objects(Param, active=True, descend_into=Block):
        for index in component.sparse_keys():
            number = number_or_nan(component[index], without=0.0)
            if not math.isfinite(number):
                name = component.name if index is None else f"{component.name}[{index}]"
                yield _error(name, f"parameter '{name}' is {number:g}.", "Give it a finite number.")
    for data in block.component_data_objects(Var, active=True, descend_into=Block):
        if data.value is not None and not math.isfinite(data.value):
            yield _error(data.name, f"'{data.name}' starts at {data.value:g}.", "Give it a finite initial guess.")
        for which, bound in (("lower", data.lower), ("upper", data.upper)):
            if bound is not None and math.isnan(number_or_nan(bound)):
                yield _error(data.name, f"'{data.name}' has a {which} bound that is no number.", "Set it, or None.")


def _because(expression: Any) -> str:
    """The part of an expression that has no value, in words."""
    part = undefined_part(expression)
    return "" if part is None else f": {part.what}"


def values_missing(block: Any) -> list[str]:
    """Names of components some of whose variables have no value to start from."""
    variables = block.component_data_objects(Var, active=True, descend_into=Block)
    return sorted({data.parent_component().name for data in variables if data.value is None})


def _error(name: str, message: str, remedy: str) -> Finding:
    return Finding(Severity.ERROR, Subject.DATA, message, (name,), remedy)


def _waits_for_a_value(expression: Any) -> bool:
    """True when the expression has no value just because a variable in it has none yet."""
    if not hasattr(expression, "is_expression_type"):
        return False
    return any(variable.value is None for variable in variables_in(expression, include_fixed=True))


def _and_more(count: int, noun: str) -> str:
    return "" if count == 1 else f", and at {count - 1} more {noun}{'s' if count > 2 else ''}"


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
        for statement, name, gap in _violated(phase, point, time, remarks):
            yield Finding(
                Severity.ERROR,
                Subject.START,
                f"phase '{phase.name}': the {where} values violate {statement.kind} '{name}' by {gap:.3g} at "
                f"t = {time:g}: {', '.join(f'{key} = {number:g}' for key, number in values.items())}.",
                (f"{phase.name}.{statement.name}",),
                f"Give {where} values that satisfy it, or leave one of them free.",
                time,
            )


def _violated(phase: Any, point: PointModel, time: float, remarks: list[str]) -> list[tuple[Statement, str, float]]:
    """Statements that the values of a point violate, the names of their rows, and by how much."""
    found = []
    try:
        for statement in phase.record.statements:
            if statement.kind not in ("residual", "constraint"):
                continue
            try:
                result = point.result_of(statement, time)
            except Exception as error:  # a rule was written for its points only: anything may come out elsewhere
                remarks.append(f"'{statement.name}' of phase '{phase.name}' at t = {time:g} ({error})")
                continue
            for label, row in labelled_rows(statement.kind, result).items():
                gap = relation_violation(row, unknown=0.0)
                if gap > TOLERANCE:
                    name = statement.name if label is None else f"{statement.name}[{label}]"
                    found.append((statement, name, gap))
    finally:
        point.leave_nodes()
    return found


def decided_findings(block: Any) -> Iterator[Finding]:
    """Rows without a variable that may move, which do not hold; fixed values outside their bounds."""
    for row in block.component_data_objects(Constraint, active=True, descend_into=Block):
        if next(variables_in(row.body, include_fixed=False), None) is None and abs(residual_of(row)) > TOLERANCE:
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
