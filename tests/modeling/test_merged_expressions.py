"""Expressions that are evaluated together have the values that each has by itself."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.modeling.merged_expressions import MergedExpressions
from pyrobocop_pyomo.phases.instant_rules import ARRAY_FUNCTIONS

NUMBERS = st.floats(-2, 2)


@settings(max_examples=30, deadline=None)
@given(points=st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS, st.integers(0, 2)), min_size=1, max_size=8))
def test_each_point_has_its_own_expression(points):
    table = rcp.Table([-3, -1, 1, 3], [1.0, 0.0, 2.0, 1.0])
    m = pyo.ConcreteModel()
    m.x, m.y, m.gain = pyo.Var(), pyo.Var(), pyo.Param(initialize=1.5, mutable=True)
    m.shared = pyo.Expression(expr=m.x * m.y + 1)

    def at(number, case):
        common = number * m.shared + m.gain
        return [
            [pyo.sin(common) + common**2, m.x][case % 2],
            [number, table(m.y) - common / 3, pyo.Expr_if(m.x <= number, m.y, -common)][case],
        ]

    expressions = [at(number, case) for _, _, number, case in points]
    columns = [np.array([point[i] for point in points]) for i in (0, 1)]
    found = MergedExpressions(expressions, [m.x, m.y])(columns, ARRAY_FUNCTIONS)
    for i, (x, y, _, _) in enumerate(points):
        m.x.set_value(x), m.y.set_value(y)
        np.testing.assert_allclose(found[i], [pyo.value(entry) for entry in expressions[i]], rtol=1e-12, atol=1e-12)
