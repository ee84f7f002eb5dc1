"""Values of an expression whose variables are replaced by arrays, or by Taylor forms."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any

import numpy as np
from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.expr import numeric_expr
from pyomo.core.expr.numvalue import NumericValue, value
from pyomo.core.expr.template_expr import GetItemExpression

from pyrobocop_pyomo.errors import ObstacleError

from .taylor_forms import TaylorForm


def _function(name: str) -> Callable[[Any], Any]:
    of_array = getattr(np, name)
    return lambda argument: getattr(argument, name)() if isinstance(argument, TaylorForm) else of_array(argument)


FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "sin": _function("sin"),
    "cos": _function("cos"),
    "tan": _function("tan"),
    "atan": _function("arctan"),
    "exp": _function("exp"),
    "log": _function("log"),
    "sqrt": _function("sqrt"),
}

OPERATIONS: dict[type, Callable[[Any, Any], Any]] = {
    numeric_expr.SumExpression: operator.add,
    numeric_expr.ProductExpression: operator.mul,
    numeric_expr.DivisionExpression: operator.truediv,
}


class ExpressionValues:
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
        self._values: dict[int, Any] = dict(leaves)
        # Values are stored by id: a temporary node, as LinearExpression makes them, has to live on to keep its id.
        self._seen: list[Any] = []

    def of(self, node: Any) -> Any:
        """Value of an expression."""
        if node.__class__ in native_numeric_types:
            return float(node)
        if id(node) not in self._values:
            self._seen.append(node)
            self._values[id(node)] = self._evaluate(node)
        return self._values[id(node)]

    def _evaluate(self, node: Any) -> Any:
        if not isinstance(node, NumericValue):
            raise _unknown(node, "is not numeric")
        if isinstance(node, GetItemExpression):
            raise ObstacleError(
                f"'{node}' is read from the model itself. The rule of a pose has to read variables through its first "
                "argument: write pose=lambda b, t: ... b.x[t] ..., where b is the parent of the avoidance block."
            )
        if not node.is_expression_type():
            number = value(node, exception=False)
            if number is None:
                raise ObstacleError(f"'{node.name}' has no value. Solve the model first, or give it an initial guess.")
            return float(number)
        if node.is_named_expression_type():
            return self.of(node.arg(0))
        if isinstance(node, numeric_expr.PowExpression):
            base, exponent = map(self.of, node.args)
            if not isinstance(exponent, float):
                raise _unknown(node, "has an exponent that changes in time")
            return base**exponent
        if isinstance(node, numeric_expr.UnaryFunctionExpression):
            name = node.getname()
            if name not in FUNCTIONS:
                raise _unknown(node, f"holds the function '{name}'")
            return self._plain(FUNCTIONS[name](self.of(node.arg(0))))
        if isinstance(node, numeric_expr.NegationExpression):
            return -self.of(node.arg(0))
        operation = next((made for base, made in OPERATIONS.items() if isinstance(node, base)), None)
        if operation is None:
            raise _unknown(node, f"is a {type(node).__name__}")
        return reduce(operation, map(self.of, node.args))

    @staticmethod
    def _plain(number: Any) -> Any:
        return float(number) if np.ndim(number) == 0 and not isinstance(number, TaylorForm) else number


def _unknown(node: Any, why: str) -> ObstacleError:
    return ObstacleError(
        f"'{node}' {why}. Between nodes a pose can be followed when it is made of sums, products, quotients, powers "
        f"with a constant exponent, and the functions {', '.join(FUNCTIONS)}."
    )
