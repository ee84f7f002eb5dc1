"""Formulas that derivatives cannot follow: absolute values that pass zero, and products that are to be zero."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.expr.numvalue import native_types

from pyrobocop_pyomo.complementarity.absolute_values import has_kink, is_smooth_product
from pyrobocop_pyomo.complementarity.switched_products import is_zero_product

from .findings import Finding, Subject, warning_about

# Rows of one component come from one rule, which says the same at each time: the first ones are looked at. Of long
# expressions, so many parts are.
_ROWS = 8
_LOOKED_AT = 2000


def form_findings(model: Any) -> Iterator[Finding]:
    """Absolute values and products that are to be zero, one finding per component and kind.

    Parameters
    ----------
    model : Block
    """
    for component in model.component_objects((Constraint, Objective), active=True, descend_into=Block):
        objective = component.ctype is Objective
        rows = list(islice(component.values(), _ROWS))
        kinks = (_absolute_value(row.expr if objective else row.body) for row in rows)
        if (kink := next((kink for kink in kinks if kink is not None), None)) is not None:
            yield _of_absolute_value(component, kink, objective)
        if not objective and any(map(is_zero_product, rows)):
            yield _of_product(component)


def holds_absolute_value(model: Any) -> bool:
    """Whether `form_findings` would name an absolute value of a model."""
    components = model.component_objects((Constraint, Objective), active=True, descend_into=Block)
    rows = (row for component in components for row in islice(component.values(), _ROWS))
    return any(row.active and _absolute_value(row.expr) is not None for row in rows)


def _of_absolute_value(component: Any, argument: Any, objective: bool) -> Finding:
    parts = (
        "In an objective that falls with it, split the quantity: two controls with bounds=(0, None) whose difference "
        "it is, and their sum in place of abs(...). "
        if objective
        else ""
    )
    return warning_about(
        Subject.STATEMENT,
        f"'{component.name}' holds abs(...) of {_shortened(argument)}, which has no derivative at zero, where optima "
        "tend to be.",
        (component.name,),
        f"{parts}pyo.TransformationFactory('pyrobocop.absolute_values_to_complementarity').apply_to(model) puts two "
        "such parts in place of every absolute value. On a phase, b.size = "
        "rcp.mechanics.AbsoluteValue(lambda b, t: ...) states it exactly, and "
        "sqrt(x**2 + 1e-6) rounds it off.",
    )


def _of_product(component: Any) -> Finding:
    return warning_about(
        Subject.STATEMENT,
        f"constraint '{component.name}' states that a product is zero; its derivatives vanish where both factors do, "
        "and solvers stall there.",
        (component.name,),
        "State a pair, on a phase under @b.complementarity: rcp.complements(first >= 0, second >= 0), or "
        "rcp.either_zero(first >= 0, second) where the second factor may have any sign.",
    )


def _absolute_value(expression: Any) -> Any:
    """The argument of the first absolute value whose argument may be zero; None where there is none."""
    stack, looked_at = [expression], 0
    while stack and looked_at < _LOOKED_AT:
        node = stack.pop()
        looked_at += 1
        if node.__class__ in native_types or not node.is_expression_type() or is_smooth_product(node):
            continue
        if has_kink(node):
            return node.arg(0)
        stack.extend(node.args)
    return None


def _shortened(expression: Any, most: int = 60) -> str:
    text = str(expression)
    return f"'{text}'" if len(text) <= most else "an expression"
