"""Formulas that derivatives cannot follow: absolute values that pass zero, and products that are to be zero."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.expr.numeric_expr import AbsExpression, MonomialTermExpression, ProductExpression
from pyomo.core.expr.numvalue import native_types, value

from pyrobocop_pyomo.modeling.expressions import holds_variable, is_plain_variable

from .findings import Finding, Severity, Subject

# Rows of one component come from one rule: the first of them is looked at. Of long expressions, so many parts are.
_LOOKED_AT = 2000


def form_findings(model: Any) -> Iterator[Finding]:
    """Absolute values and products that are to be zero, one finding per component and kind.

    Parameters
    ----------
    model : Block
    """
    for component in model.component_objects((Constraint, Objective), active=True, descend_into=Block):
        for data in islice(component.values(), 1):
            objective = component.ctype is Objective
            body = data.expr if objective else data.body
            if (kink := _absolute_value(body)) is not None:
                yield _of_absolute_value(component, kink, objective)
            if not objective and _is_product_at_zero(data):
                yield _of_product(component)


def _of_absolute_value(component: Any, argument: Any, objective: bool) -> Finding:
    parts = (
        "In an objective that falls with it, split the quantity: two controls with bounds=(0, None) whose difference "
        "it is, and their sum in place of abs(...). "
        if objective
        else ""
    )
    return Finding(
        Severity.WARNING,
        Subject.STATEMENT,
        f"'{component.name}' holds abs(...) of {_shortened(argument)}, which has no derivative at zero, where optima "
        "tend to be.",
        (component.name,),
        f"{parts}On a phase, b.size = rcp.mechanics.AbsoluteValue(lambda b, t: ...) states it exactly, and "
        "sqrt(x**2 + 1e-6) rounds it off.",
    )


def _of_product(component: Any) -> Finding:
    return Finding(
        Severity.WARNING,
        Subject.STATEMENT,
        f"constraint '{component.name}' states that a product is zero; its derivatives vanish where both factors do, "
        "and solvers stall there.",
        (component.name,),
        "Where neither factor may be negative, state a pair: complements(first >= 0, second >= 0), on a phase under "
        "@b.complementarity. Where only the first has a sign: rcp.either_zero(first >= 0, second).",
    )


def _absolute_value(expression: Any) -> Any:
    """The argument of the first absolute value whose argument may be zero; None where there is none."""
    stack, looked_at = [expression], 0
    while stack and looked_at < _LOOKED_AT:
        node = stack.pop()
        looked_at += 1
        if node.__class__ in native_types or not node.is_expression_type():
            continue
        if isinstance(node, AbsExpression) and holds_variable(node.arg(0)) and _may_be_zero(node.arg(0)):
            return node.arg(0)
        stack.extend(node.args)
    return None


def _may_be_zero(argument: Any) -> bool:
    if not is_plain_variable(argument):
        return True
    lower, upper = argument.bounds
    return (lower is None or lower <= 0.0) and (upper is None or upper >= 0.0)


def _is_product_at_zero(row: Any) -> bool:
    """Whether a row says that a product of two variable factors, that are not the same, is zero."""
    if not row.equality or value(row.upper, exception=False) != 0.0:
        return False
    body = row.body
    if not isinstance(body, ProductExpression) or isinstance(body, MonomialTermExpression):
        return False
    first, second = body.args
    return holds_variable(first) and holds_variable(second) and first is not second


def _shortened(expression: Any, most: int = 60) -> str:
    text = str(expression)
    return f"'{text}'" if len(text) <= most else "an expression"
