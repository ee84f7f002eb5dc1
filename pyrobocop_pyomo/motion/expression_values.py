"""Values of an expression whose variables are replaced by arrays, or by Taylor forms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pyomo.core.expr.template_expr import GetItemExpression

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.expression_nodes import NUMPY_NAMES, POWER, ExpressionEvaluator, kind_of_node
from pyrobocop_pyomo.numerics.taylor_forms import TaylorForm

from .table_functions import TableFunction


def _function(name: str) -> Callable[[Any], Any]:
    of_array = getattr(np, name)

    def function(argument: Any) -> Any:
        if isinstance(argument, TaylorForm):
            return getattr(argument, name)()
        found = of_array(argument)
        return float(found) if np.ndim(found) == 0 else found

    return function


FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    name: _function(NUMPY_NAMES[name]) for name in ("sin", "cos", "tan", "atan", "exp", "log", "sqrt")
}


def _call(output: Any, *arguments: Any) -> Any:
    """An output of a `Function`: of numbers any, of arrays and Taylor forms one that knows its bounds."""
    if all(isinstance(argument, float) for argument in arguments):
        return output.evaluate(arguments)
    function = output.function
    if not isinstance(function, TableFunction):
        raise ObstacleError(
            f"'{output.name}' is a function in Python, of which nobody knows how it curves between nodes. Write the "
            "formula of the pose, or make what it computes a state."
        )
    (argument,) = arguments
    if isinstance(argument, TaylorForm):
        return function.taylor_form(argument, output.index)
    return function.values(np.asarray(argument, dtype=float)[:, None])[:, output.index]


class ExpressionValues(ExpressionEvaluator):
    """Evaluates expressions of the same variables; common subexpressions are evaluated once.

    Parameters
    ----------
    leaves : dict
        From the ``id`` of a variable to its replacement. Other variables count with their values.

    Raises
    ------
    ObstacleError
        When an expression has a function that is not supported, or a variable without value.
    """

    def __init__(self, leaves: Mapping[int, Any]) -> None:
        super().__init__(leaves, {**FUNCTIONS, "call": _call}, _refused)

    def _evaluate(self, node: Any) -> Any:
        if kind_of_node(node.__class__) == POWER and not isinstance(self.of(node.arg(1)), float):
            raise _refused(node, "has an exponent that changes in time")
        return super()._evaluate(node)


def _refused(node: Any, reason: str) -> ObstacleError:
    if isinstance(node, GetItemExpression):
        return ObstacleError(
            f"'{node}' is read from the model itself. The rule of a pose has to read variables through its first "
            "argument: write pose=lambda b, t: ... b.x[t] ..., where b is the parent of the avoidance block."
        )
    if reason == "has no value":
        return ObstacleError(f"'{node.name}' has no value. Solve the model first, or give it an initial guess.")
    return ObstacleError(
        f"'{node}' {reason}. Between nodes a pose can be followed when it is made of sums, products, quotients, powers "
        f"with a constant exponent, and the functions {', '.join(FUNCTIONS)}."
    )
