"""Numbers at the initial guess: values that are not finite, boundary values that contradict equations, decided rows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.param import Param
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import canonical_form, pairs_of
from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.continuous.discretisation import discretisations_on
from pyrobocop_pyomo.modeling.row_violations import bound_violation, number_or_nan
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.phases.boundary_conditions import KINDS, EndViolation, end_violations, values_given, violations_of
from pyrobocop_pyomo.phases.horizon import real_grid
from pyrobocop_pyomo.phases.rule_formulas import RuleFormulas

from .findings import Finding, Subject, error_about
from .linearised_rows import residual_of
from .undefined_rows import UndefinedRow, undefined_rows

REMEDY = "Change the initial guess or the data, or keep the expression away from its edge by bounds."


def undefined_findings(block: Any) -> Iterator[Finding]:
    """What has no finite value or derivative at the initial guess, the first place of each component."""
    found: dict[str, list[UndefinedRow]] = {}
    for row in undefined_rows(block):
        found.setdefault(row.component, []).append(row)
    for name, rows in found.items():
        message = f"no finite value or derivative at the initial guess: {rows[0]}{_and_more(len(rows), 'point')}."
        yield error_about(Subject.DATA, message, (name,), REMEDY)


def parameter_findings(block: Any) -> Iterator[Finding]:
    """Parameters that are no numbers."""
    for component in block.component_objects(Param, active=True, descend_into=Block):
        for index in component.sparse_keys():
            number = number_or_nan(component[index], without=0.0)
            if not math.isfinite(number):
                name = component.name if index is None else f"{component.name}[{index}]"
                yield error_about(
                    Subject.DATA, f"parameter '{name}' is {number:g}.", (name,), "Give it a finite number."
                )


def values_missing(block: Any) -> list[str]:
    """Names of components some of whose variables have no value to start from."""
    variables = block.component_data_objects(Var, active=True, descend_into=Block)
    return sorted({data.parent_component().name for data in variables if data.value is None})


def _and_more(count: int, noun: str) -> str:
    plural = noun if count == 2 else "indices" if noun == "index" else f"{noun}s"
    return "" if count == 1 else f", and at {count - 1} more {plural}"


TOLERANCE = 1e-6


def boundary_findings(phase: Any, remarks: list[str]) -> Iterator[Finding]:
    """Fixed start or end values that violate what is stated, the worst row of each rule."""
    record = phase.record
    for time, where in ((record.grid.times[0], "initial"), (record.grid.times[-1], "final")):
        values = values_given(phase, time)
        statements = [each for each in record.statements if each.kind in KINDS]
        statements = [each for each in statements if values and _is_stated(phase.component(each.name), time)]
        if not statements:
            continue
        try:
            formulas = RuleFormulas(phase, real_grid(phase))
        except (ValueError, TypeError):
            return  # the horizon has no values yet
        worst: dict[str, EndViolation] = {}
        for found in end_violations(formulas, time, values, statements, remarks):
            if found.amount > max(TOLERANCE, worst[found.statement].amount if found.statement in worst else 0.0):
                worst[found.statement] = found
        for found in worst.values():
            known = ", ".join(f"{key} = {number:g}" for key, number in found.values.items())
            yield error_about(
                Subject.START,
                f"phase '{phase.name}': the {where} values violate {_KINDS.get(found.kind, found.kind)} '{found.row}' "
                f"by {found.amount:.3g} at t = {time:g}: {known}.",
                (f"{phase.name}.{found.statement}",),
                f"Give {where} values that satisfy it, or leave one of them free.{_UNLESS.get(found.kind, '')}",
            )


SIDES_HOLD = (
    "Both sides of a pair are >= 0 at all times: what acts only where a gap is closed is "
    "complements(gap >= 0, force >= 0)."
)
_KINDS = {"complementarity": "a side of the pair", "bounds": "the bounds of"}
_UNLESS = {
    "constraint": " Where nothing is meant at that instant, let the rule return pyo.Constraint.Skip there.",
    "complementarity": f" {SIDES_HOLD} Where nothing is meant at that instant, let the rule return "
    "rcp.Complementarity.Skip there.",
}


def _is_stated(rows: Any, time: float) -> bool:
    """Whether the rows of a rule are meant at a time: neither removed nor deactivated, unless they were relaxed."""
    if rows is None:
        return False
    if not rows.active:
        return any(pair.source.parent_component() is rows for pair in pairs_of(rows.model()))
    there = [row for index, row in rows.items() if time == (index[0] if isinstance(index, tuple) else index)]
    return not there or any(row.active for row in there)


def discretised_start_findings(block: Any) -> Iterator[Finding]:
    """Fixed values that violate what is stated where a continuous set starts, and no collocation point is.

    The transformation has deactivated these rows and pairs, as far as they hold what nothing determines there.
    """
    for discretisation in discretisations_on(block):
        for data in discretisation.deactivated:
            pair = data.parent_component().ctype in PAIR_TYPES
            for relation, gap in violations_of(canonical_form(data) if pair else data.expr):
                if gap > TOLERANCE and next(variables_in(relation, include_fixed=False), None) is None:
                    yield error_about(
                        Subject.START,
                        f"the given values violate {'a side of the pair ' if pair else ''}'{data.name}' by {gap:.3g}.",
                        (data.parent_component().name,),
                        "Give values that satisfy it, or leave one of them free.",
                    )


def bound_findings(block: Any) -> Iterator[Finding]:
    """Fixed values outside their bounds, and bounds that cross: the first of each component."""
    for component in block.component_objects(Var, active=True, descend_into=Block):
        outside, crossed = [], []
        for data in component.values():
            lower, upper = data.bounds
            if data.fixed and data.value is not None and bound_violation(data.value, lower, upper) > TOLERANCE:
                message = f"'{data.name}' is fixed to {data.value:g}, outside its bounds ({lower}, {upper})"
                outside.append((message, data.name, "Change the value or widen the bounds."))
            elif not data.fixed and lower is not None and upper is not None and lower > upper:
                message = f"'{data.name}' has the lower bound {lower:g} above the upper {upper:g}"
                crossed.append((message, data.name, "Swap or widen them."))
        for wrong in filter(None, (outside, crossed)):
            message, name, remedy = wrong[0]
            yield error_about(Subject.CONTRADICTION, f"{message}{_and_more(len(wrong), 'index')}.", (name,), remedy)


def decided_findings(block: Any) -> Iterator[Finding]:
    """Rows without a variable that may move, which do not hold; fixed values outside their bounds, crossed bounds."""
    yield from bound_findings(block)
    for row in block.component_data_objects(Constraint, active=True, descend_into=Block):
        if next(variables_in(row.body, include_fixed=False), None) is None and abs(residual_of(row)) > TOLERANCE:
            yield error_about(
                Subject.CONTRADICTION,
                f"'{row.name}' holds no variable that may move and is violated by {abs(residual_of(row)):.3g}.",
                (row.name,),
                "Unfix a variable in it, or correct the fixed values.",
            )
