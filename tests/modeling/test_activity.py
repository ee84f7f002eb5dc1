"""What is active between a component and a model."""

from __future__ import annotations

import pyomo.environ as pyo

from pyrobocop_pyomo.modeling.activity import deactivate, enclosing_blocks, is_inside, outermost_inactive


def nested():
    m = pyo.ConcreteModel()
    m.outer = pyo.Block()
    m.outer.inner = pyo.Block([1, 2])
    m.outer.inner[1].x = pyo.Var()
    m.outer.inner[1].row = pyo.Constraint([1, 2], rule=lambda b, i: b.x >= i)
    return m


def test_a_component_is_inside_all_of_the_blocks_that_enclose_it():
    m = nested()
    inner = m.outer.inner[1]
    assert list(enclosing_blocks(inner.x)) == [inner, m.outer, m]
    assert all(is_inside(inner.x, block) for block in (inner, m.outer, m))
    assert not is_inside(inner.x, m.outer.inner[2])
    assert not is_inside(m, m)


def test_the_outermost_inactive_block_below_the_model_is_found():
    m = nested()
    row = m.outer.inner[1].row[1]
    assert outermost_inactive(row, m) is None
    m.outer.inner[1].deactivate()
    assert outermost_inactive(row, m) is m.outer.inner[1]
    m.outer.deactivate()
    assert outermost_inactive(row, m) is m.outer
    m.deactivate()
    assert outermost_inactive(m, m) is None


def test_a_component_is_deactivated_with_the_last_of_its_parts():
    row = nested().outer.inner[1].row
    deactivate([row[1]])
    assert row.active
    assert not row[1].active
    deactivate([row[2]])
    assert not row.active
