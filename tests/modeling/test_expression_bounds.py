"""Bounds of expressions contain all values, of every function that Pyomo has, on any interval of its variable."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pyomo.environ as pyo
import pytest

from pyrobocop_pyomo.modeling.expression_bounds import ExpressionBounds
from pyrobocop_pyomo.modeling.expression_nodes import NUMPY_NAMES

FUNCTIONS = {name: getattr(pyo, name, abs) for name in NUMPY_NAMES} | {
    "root": lambda x: x**0.5,
    "inverse": lambda x: x**-2,
    "cube": lambda x: x**3,
    "power": lambda x: x**x,
    "choice": lambda x: pyo.Expr_if(x >= 0.3, x, -2 * x),
}
ENDS = [-math.inf, -1e200, -800.0, -2.5, -1.0, 0.0, 1.0, 3.0, 800.0, 1e200, math.inf]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_all_values_lie_within(name: str) -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var()
    expression = FUNCTIONS[name](m.x)
    for lower, upper in combinations(ENDS, 2):
        m.x.setlb(lower)
        m.x.setub(upper)
        least, most = ExpressionBounds().walk_expression(expression)
        for number in np.linspace(max(lower, -20.0), min(upper, 20.0), 23).tolist():
            m.x.set_value(number, skip_validation=True)
            try:
                found = pyo.value(expression, exception=False)
            except (ArithmeticError, ValueError):
                continue
            if isinstance(found, float) and math.isfinite(found) and lower <= number <= upper:
                slack = 1e-12 * (1.0 + abs(found))
                assert least - slack <= found <= most + slack, (lower, upper, number)
