"""A phase wherever Pyomo lets a block live: indexed, nested, cloned, pickled, deactivated, abstract."""

from __future__ import annotations

import math
import pickle
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import contents, exact_x, oscillate, rows, solve
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp


def state_oscillators(b: Any, *index: Any) -> None:
    b.x = rcp.State(initial=1, initial_guess=ramp, bounds=wide)
    b.y = rcp.State(initial=1, initial_guess=1)
    b.push = rcp.Control(parametrization="piecewise_constant")
    b.push_per_element.fix(0)
    b.ode(pushed)


def ramp(t: float) -> float:
    return 1 + t


def wide(t: float) -> tuple[float, float]:
    return (-100, 100)


def pushed(b: Any, t: float) -> Any:
    rates = oscillate(b, t)
    return {b.x: rates[b.x] + b.push[t], b.y: rates[b.y]}


def end(b: Any) -> float:
    return b.x[b.final_time].value


def solved(m: pyo.ConcreteModel) -> pyo.ConcreteModel:
    m.nothing = pyo.Objective(expr=0)
    solve(m)
    return m


@pytest.mark.casadi
def test_one_rule_builds_scalar_indexed_and_nested_phases() -> None:
    def nested(b, i):
        b.phase = rcp.PhaseBlock(rule=state_oscillators)

    m = pyo.ConcreteModel()
    m.I = pyo.Set(initialize=["left", 2])
    m.scalar = rcp.PhaseBlock(rule=state_oscillators)
    m.many = rcp.PhaseBlock(m.I, rule=state_oscillators)
    m.grid = rcp.PhaseBlock(m.I, [1, 2], rule=state_oscillators)
    m.house = pyo.Block()
    m.house.phase = rcp.PhaseBlock(rule=state_oscillators)
    m.arms = pyo.Block(m.I, rule=nested)
    phases = [m.scalar, *m.many.values(), *m.grid.values(), m.house.phase, *(arm.phase for arm in m.arms.values())]
    assert len(phases) == 1 + 2 + 4 + 1 + 2
    solved(m)
    for phase in phases:
        phase.check()
        assert phase.ctype is pyo.Block
        assert end(phase) == pytest.approx(exact_x(1.0), abs=1e-6)
        assert phase.trajectory().name == phase.name
    assert m.arms[2].phase.name == "arms[2].phase"


def test_a_rule_gets_its_index() -> None:
    def build(b, i, j):
        b.x = rcp.State(initial=10 * i + j)

    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock([1, 2], [3, 4], rule=build)
    assert [b.x[0].value for b in m.p.values()] == [13, 14, 23, 24]


@pytest.mark.casadi
def test_a_clone_lives_its_own_life() -> None:
    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock(rule=state_oscillators, duration=rcp.Duration(bounds=(1, 2)))
    m.p.duration.fix(1)
    before = {id(v): v.value for v in m.component_data_objects(pyo.Var)}
    clone = m.clone()
    assert contents(clone) == contents(m)
    solved(clone)
    assert end(clone.p) == pytest.approx(exact_x(1.0), abs=1e-6)
    assert {id(v): v.value for v in m.component_data_objects(pyo.Var)} == before
    first = clone.p.points.first()
    assert all(v.model() is clone for row in rows(clone) for v in identify_variables(row.body))
    assert all(v.model() is clone for v in identify_variables(clone.p.derivative(clone.p.x)[first]))
    assert clone.p.push[first] is clone.p.push_per_element[0]
    assert clone.p.trajectory().verify().defect < 1e-10
    assert clone.p.trajectory().phase is clone.p
    assert m.p.trajectory().verify().defect > 0.1
    clone.p.late = rcp.State(initial=0)
    assert "late" not in m.p.record.declarations
    assert m.p.component("late") is None


@pytest.mark.casadi
def test_a_pickle_with_rules_of_a_module_comes_back_whole() -> None:
    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock(rule=state_oscillators)
    back = pickle.loads(pickle.dumps(m))
    assert contents(back) == contents(m)
    solved(back)
    assert end(back.p) == pytest.approx(exact_x(1.0), abs=1e-6)
    assert end(m.p) == 2.0
    verdict = back.p.trajectory().verify()
    assert verdict.largest_violation < 1e-10
    assert verdict.horizon_error is not None
    assert back.p.push[back.p.points.first()] is back.p.push_per_element[0]


@pytest.mark.casadi
def test_a_pickle_with_lambdas_comes_back_with_what_they_said() -> None:
    def build(b):
        b.x = rcp.State(initial=1, initial_guess=lambda t: 1 + t)
        b.y = rcp.State(initial=1, initial_guess=1)
        b.ode(lambda b, t: oscillate(b, t))

    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock(rule=build)
    for model in (solved(pickle.loads(pickle.dumps(m))), solved(m)):
        assert end(model.p) == pytest.approx(exact_x(1.0), abs=1e-6)
        assert model.p.trajectory().verify().largest_violation < 1e-10


@pytest.mark.parametrize("bounds", [lambda t: (-t, 5), lambda t: (-math.floor(2 * t) / 2, 5)])
def test_a_pickle_has_what_a_function_for_bounds_has_said(bounds: Any) -> None:
    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock(elements=2)
    m.p.x = rcp.State(initial=1, bounds=bounds)
    m.p.ode(still)
    back = pickle.loads(pickle.dumps(m))
    assert back.p.x[1.0].bounds == (-1, 5)
    for phase in (m.p, back.p):
        phase.x[1.0].set_value(-2.0, skip_validation=True)
    assert back.p.trajectory().verify().bounds == m.p.trajectory().verify().bounds == 1.0


def still(b: Any, t: float) -> Any:
    return {b.x: 0.0}
