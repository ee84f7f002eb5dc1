"""Formulas that derivatives cannot follow: absolute values that pass zero, and products that are to be zero."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.expr.numvalue import native_types

from pyrobocop_pyomo.complementarity.absolute_values import has_kink, is_smooth_product, is_zero_product
from pyrobocop_pyomo.modeling.rows_by_rule import RepeatedSum, as_read, follows_rule

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
    for component, argument in _absolute_values(model):
        yield _of_absolute_value(component, argument)
    for component in model.component_objects(Constraint, active=True, descend_into=Block):
        if any(map(is_zero_product, map(as_read, islice(component.values(), _ROWS)))):
            yield warning_about(
                Subject.STATEMENT,
                f"constraint '{component.name}' states that a product is zero; its derivatives vanish where both "
                "factors do, and solvers stall there.",
                (component.name,),
                "State a pair, on a phase under @b.complementarity: rcp.complements(first >= 0, second >= 0), or "
                "rcp.either_zero(first >= 0, second) where the second factor may have any sign.",
            )


def holds_absolute_value(model: Any) -> bool:
    """Whether `form_findings` would name an absolute value of a model."""
    return any(True for _ in _absolute_values(model))


def _absolute_values(model: Any) -> Iterator[tuple[Any, Any]]:
    """Components with the argument of their first absolute value that may pass zero."""
    for component in model.component_objects((Constraint, Objective), active=True, descend_into=Block):
        arguments = (_absolute_value(as_read(row).expr) for row in islice(component.values(), _ROWS) if row.active)
        argument = next((argument for argument in arguments if argument is not None), None)
        if argument is not None:
            yield component, argument


def _of_absolute_value(component: Any, argument: Any) -> Finding:
    parts = (
        "In an objective that falls with it, split the quantity: two controls with bounds=(0, None) whose difference "
        "it is, and their sum in place of abs(...). "
        if component.ctype is Objective
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
        stack.extend([_last_summand(node.repeated())] if follows_rule(node) else node.args)
    return None


def _last_summand(repeated: RepeatedSum) -> Any:
    return repeated.expression(len(repeated.rows) - 1)


def _shortened(expression: Any, most: int = 60) -> str:
    text = str(expression)
    return f"'{text}'" if len(text) <= most else "an expression"
