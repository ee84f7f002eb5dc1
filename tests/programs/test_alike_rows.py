"""Rows that are written alike give the same terms whether they are taken apart together or one by one."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo
import pytest
from harness.expression_zoo import trees
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyomo.core.expr.visitor import replace_expressions

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.shared_nodes import nodes_of, variables_in_any
from pyrobocop_pyomo.programs.model_terms import ModelTerms, Terms, collect_terms

COUNT = 12
SYMBOLS = pyo.ConcreteModel()
SYMBOLS.x = pyo.Var(range(4), initialize=0.5)
LEAVES = st.one_of(st.sampled_from(list(SYMBOLS.x.values())), st.floats(-2, 2), st.integers(-3, 3))


def written_alike(pattern: Any, fixed: int, other: int) -> pyo.ConcreteModel:
    """A pattern with other variables in each row; one variable is fixed, and one row may be another one."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(4 + COUNT), initialize=0.5)
    m.p = pyo.Param(range(COUNT), initialize=lambda m, i: 0.1 * i, mutable=True)
    m.x[fixed].fix()

    def row(m, i):
        moved = {id(SYMBOLS.x[j]): m.x[i + j] for j in range(4)}
        expression = replaced(pattern, moved)
        body = expression + m.p[i] * m.x[i] - 2.0 * m.x[i + 1] if i != other else m.x[i] ** 3
        return pyo.inequality(-1, body, 1)

    m.rows = pyo.Constraint(range(COUNT), rule=row)
    m.cost = pyo.Objective(expr=m.x[0])
    return m


def replaced(pattern: Any, moved: dict[int, Any]) -> Any:
    return replace_expressions(pattern, moved) if hasattr(pattern, "is_expression_type") else pattern


def as_found(found: ModelTerms) -> tuple[Any, ...]:
    """All that a walk found by names, with the triplets of a row in any order."""
    rows, parameters = found.rows, [p.name for p in found.columns.parameters]
    names = [v.name for v in found.variables] + parameters[::-1]  # a parameter has a negative column
    groups = {
        code: (
            g.rows, g.scales, [names[c] for c in g.columns], g.numbers, [(at, parameters[p]) for at, p in g.parameters]
        )
        for code, g in rows.groups.items()
    }  # fmt: skip
    columns = [names[c] for c in rows.linear_columns]
    triplets = sorted(zip(rows.linear_rows, columns, rows.linear_coefficients, strict=True))
    return sorted(names), triplets, rows.constants, groups, [row.name for row in found.constraints], found.bounds


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(pattern=trees(LEAVES), fixed=st.integers(0, 15), other=st.integers(0, 40))
def test_together_or_one_by_one(pattern, fixed, other):
    m = written_alike(pattern, fixed, other)
    together, apart = read(m), read(m, alike=False)
    assert (together is None) == (apart is None)
    if together is not None and apart is not None:
        assert as_found(together) == as_found(apart)


def read(m: pyo.ConcreteModel, *, alike: bool = True) -> ModelTerms | None:
    with pytest.MonkeyPatch.context() as patch:
        if not alike:
            patch.setattr(Terms, "add_alike", lambda *_: False)
        try:
            return collect_terms(m)
        except ModelError:
            return None


def test_alike_rows_of_a_linear_pattern_are_taken_together():
    m = written_alike(pyo.sin(SYMBOLS.x[0]) * SYMBOLS.x[2] + 3 * SYMBOLS.x[3], fixed=15, other=-1)
    terms = Terms(collect_terms(m).columns)
    assert terms.add_alike(0, [row.body for row in m.rows.values()])
    assert terms.linear_rows == [i for i in range(COUNT) for _ in range(2)]


def test_rows_without_free_variables_are_left_to_the_walk_over_each():
    m = written_alike(pyo.sin(SYMBOLS.x[0]), fixed=0, other=-1)
    m.x.fix()
    m.x[3].unfix()
    found = collect_terms(m)
    assert [row.index() for row in found.constraints] == [2, 3]
    assert len(found.constant_constraints) == COUNT - 2


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(pattern=trees(LEAVES), other=st.integers(0, 40))
def test_variables_of_many_expressions_are_those_of_each(pattern, other):
    m = written_alike(pattern, fixed=0, other=other)
    bodies = [row.body for row in m.rows.values()]
    each = {id(node) for body in bodies for node in nodes_of(body) if node.is_variable_type()}
    assert set(variables_in_any(bodies)) == each
