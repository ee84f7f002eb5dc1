"""Numbers that are none: right-hand sides, rows, objectives, parameters, bounds and guesses that are not finite."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.objective import Objective
from pyomo.core.base.param import Param
from pyomo.core.base.var import Var
from pyomo.core.expr.visitor import identify_variables

from pyrobocop_pyomo.modeling.row_violations import number_or_nan

from .findings import Finding, Severity, Subject
from .linearisation import Linearisation, gradient

GUESS = "Change the guess or the data, or keep the expression away from its edge by bounds."


def rate_findings(phase: Any) -> Iterator[Finding]:
    """Right-hand sides without a finite value at the guess, by the first time at which it shows."""
    for name, rates in phase.record.rates.items():
        wrong = [(time, number) for time, rate in rates.items() if not math.isfinite(number := number_or_nan(rate))]
        if wrong and not _waits_for_a_value(rates[wrong[0][0]]):
            time, number = wrong[0]
            rule = phase.record.equation_of[name]
            yield Finding(
                Severity.ERROR,
                Subject.DATA,
                f"phase '{phase.name}': the right-hand side of '{name}' in ode '{rule}' is {number:g} at t = {time:g}"
                f"{_and_more(len(wrong), 'point')}.",
                (f"{phase.name}.{name}",),
                GUESS,
                time,
            )


def row_findings(linearisation: Linearisation, reported: set[str]) -> Iterator[Finding]:
    """Rows without a finite value or derivative at the guess, one finding per component."""
    wrong: dict[str, list[Any]] = {}
    for row in linearisation.rows:
        if not row.is_finite and not _waits_for_a_value(row.data.body):
            wrong.setdefault(row.data.parent_component().name, []).append(row)
    for name, rows in wrong.items():
        if name in reported:
            continue
        first = rows[0]
        if math.isfinite(first.residual):
            column = next(j for j, entry in first.gradient.items() if not math.isfinite(entry))
            what = f"has no finite derivative by '{linearisation.variables[column].name}'"
        else:
            what = f"has the value {first.residual:g}"
        index = first.data.index()
        yield Finding(
            Severity.ERROR,
            Subject.DATA,
            f"'{first.data.name}' {what} at the guess{_and_more(len(rows), 'row')}.",
            (name,),
            GUESS,
            index if isinstance(index, float) else None,
        )


def data_findings(block: Any) -> Iterator[Finding]:
    """Objectives, parameters, bounds and guesses."""
    for objective in block.component_data_objects(Objective, active=True, descend_into=Block):
        entries = gradient(objective.expr, identify_variables(objective.expr, include_fixed=False))
        number = number_or_nan(objective.expr)
        if not _waits_for_a_value(objective.expr):
            bad = next((v.name for v, entry in entries if not math.isfinite(entry)), None)
            if not math.isfinite(number) or bad is not None:
                what = f"has no finite derivative by '{bad}'" if math.isfinite(number) else f"is {number:g}"
                yield _error(objective.name, f"objective '{objective.name}' {what} at the guess.", GUESS)
    for component in block.component_objects(Param, active=True, descend_into=Block):
        for index in component.sparse_keys():
            number = number_or_nan(component[index], without=0.0)
            if not math.isfinite(number):
                name = component.name if index is None else f"{component.name}[{index}]"
                yield _error(name, f"parameter '{name}' is {number:g}.", "Give it a finite number.")
    for data in block.component_data_objects(Var, active=True, descend_into=Block):
        if data.value is not None and not math.isfinite(data.value):
            yield _error(data.name, f"'{data.name}' starts at {data.value:g}.", "Give it a finite guess.")
        for which, bound in (("lower", data.lower), ("upper", data.upper)):
            if bound is not None and math.isnan(number_or_nan(bound)):
                yield _error(data.name, f"'{data.name}' has a {which} bound that is no number.", "Set it, or None.")


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
    return any(variable.value is None for variable in identify_variables(expression, include_fixed=True))


def _and_more(count: int, noun: str) -> str:
    return "" if count == 1 else f", and at {count - 1} more {noun}{'s' if count > 2 else ''}"
