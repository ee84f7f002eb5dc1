"""Snapshots of values, violations of rows, and the blocks of a kind."""

import math
from typing import Any

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.row_violations import (
    bound_violation,
    constraint_violation,
    largest_violation,
    number_or_nan,
    relation_violation,
)
from pyrobocop_pyomo.modeling.variable_values import VariableValues, values_restored


def model() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.x = pyo.Var([1, 2, 3], initialize={1: 1.0, 2: 2.0})
    m.x[2].fix()
    m.asleep = pyo.Block()
    m.asleep.y = pyo.Var(initialize=5.0)
    m.asleep.deactivate()
    return m


def test_free_variables_of_active_blocks_or_all_of_them() -> None:
    m = model()
    assert [variable.name for variable in VariableValues.of_free(m).variables] == ["x[1]", "x[3]"]
    assert VariableValues.of_free(m).taken == [1.0, None]
    assert VariableValues.of_all(m).taken == [1.0, 2.0, None, 5.0]


def test_values_come_back_with_their_flags() -> None:
    m = model()
    before = VariableValues.of_free(m)
    m.x[1].set_value(7.0)
    m.x[3].set_value(8.0)
    assert before.read() == [7.0, 8.0]
    assert before.by_variable[m.x[1]] == 1.0
    before.restore()
    assert before.read() == [1.0, None]
    assert m.x[3].stale


def test_a_model_may_grow_and_shrink_meanwhile() -> None:
    m = model()
    m.z = pyo.Var(initialize=3.0)
    before = VariableValues.of_free(m)
    m.del_component(m.z)
    m.new = pyo.Var(initialize=4.0)
    m.x[1].set_value(9.0)
    before.restore()
    assert m.x[1].value == 1.0
    assert m.new.value == 4.0


def test_a_twin_takes_the_values_and_another_model_does_not() -> None:
    m, twin = model(), model()
    m.x[3].set_value(-3.0)
    VariableValues.of_all(twin).write(VariableValues.of_all(m).taken)
    assert twin.x[3].value == -3.0
    with pytest.raises(ModelError, match="the model built again has 4 variables where 1 were found"):
        VariableValues.of_all(twin).write([1.0])


def fail_after_writing(variable: Any, number: float) -> None:
    with values_restored([variable]) as values:
        values.write([number])
        raise ZeroDivisionError(variable.value)


def test_values_are_put_back_whatever_happens() -> None:
    m = model()
    with pytest.raises(ZeroDivisionError, match="10"):
        fail_after_writing(m.x[1], 10.0)
    assert m.x[1].value == 1.0


@pytest.mark.parametrize(
    ("relation", "violation"),
    [
        (lambda x: x == 3, 1.0),
        (lambda x: x <= 1.5, 0.5),
        (lambda x: x >= 1.5, 0.0),
        (lambda x: pyo.inequality(0, x, 0.5), 1.5),
        (lambda x: (None, x, 1), 1.0),
        (lambda x: (5, x, None), 3.0),
        (lambda x: (x, 4), 2.0),
        (lambda x: x - 1, 1.0),
        (lambda x: pyo.Constraint.Skip, 0.0),
    ],
)
def test_how_far_a_relation_is_from_holding(relation: Any, violation: float) -> None:
    m = model()
    assert relation_violation(relation(m.x[2]), unknown=0.0) == violation


def test_where_a_value_is_not_known_the_violation_is_what_is_asked_for() -> None:
    m = model()
    for relation in (m.x[3] == 1, m.x[3] <= 1, (0, m.x[3], 1), m.x[3]):
        assert relation_violation(relation, unknown=0.25) == 0.25


def test_violations_of_rows_and_of_bounds() -> None:
    m = model()
    m.c = pyo.Constraint(expr=m.x[1] + m.x[2] <= 2)
    m.d = pyo.Constraint(expr=m.x[2] == 2)
    assert constraint_violation(m.c) == 1.0
    assert largest_violation([m.c, m.d]) == 1.0
    assert largest_violation([]) == 0.0
    m.e = pyo.Constraint(expr=m.x[3] == 2)
    assert math.isnan(largest_violation([m.c, m.e, m.d]))
    assert bound_violation(float("nan"), None, None) == math.inf
    assert math.isnan(number_or_nan((-1.0 * m.x[1]) ** 0.5))


def test_the_active_phases_of_a_model_wherever_they_are() -> None:
    m = pyo.ConcreteModel()
    m.first = rcp.PhaseBlock()
    m.group = pyo.Block()
    m.group.legs = rcp.PhaseBlock(["a", "b"], rule=lambda b, i: None)
    m.other = rcp.PhaseBlock()
    m.other.deactivate()
    assert [phase.name for phase in rcp.phases_of(m)] == ["first", "group.legs[a]", "group.legs[b]"]
    assert rcp.phases_of(m.first) == [m.first]
