"""What reads a variable of another model is refused, wherever it stands; what is of the same model is not."""

import copy
from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import one_phase

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError


def drive(name: str) -> pyo.ConcreteModel:
    m, b = one_phase("go", model=name, duration=1.0, elements=2)
    b.x, b.v = rcp.State(initial=0, final=1), rcp.Control(bounds=(-5, 5))
    b.y = rcp.State(initial=0)
    m.mass = pyo.Var(initialize=1.0)
    return m


def finished(m: Any) -> pyo.ConcreteModel:
    m.go.ode(lambda b, t: {b.x: b.v[t], b.y: 0.0})
    m.effort = pyo.Objective(expr=m.go.integral(lambda b, t: b.v[t] ** 2) + (m.mass - 1) ** 2)
    return m


RULES: dict[str, Callable[[Any, Any], Any]] = {
    "ode": lambda b, o: b.ode(lambda b, t: {b.y: o.go.v[t]}, name="said"),
    "a variable that is no signal": lambda b, o: b.ode(lambda b, t: {b.y: b.v[t] / o.mass}, name="said"),
    "residual": lambda b, o: b.residual(lambda b, t: b.x[t] == o.go.x[t], name="said"),
    "constraint": lambda b, o: b.constraint(lambda b, t: [b.x[t] <= 1, b.x[t] >= o.go.x[t]], name="said"),
    "complementarity": lambda b, o: b.complementarity(
        lambda b, t: rcp.complements(b.v[t] >= 0, o.go.x[t] >= 0), name="said"
    ),
    "integral": lambda b, o: b.integral(lambda b, t: (b.x[t] - o.go.x[t]) ** 2),
    "vectors": lambda b, o: b.ode(lambda b, t: {b.y: rcp.array([b.v[t], o.go.v[t]]).sum()}, name="said"),
    "law": lambda b, o: b.declare("said", rcp.mechanics.AbsoluteValue(lambda b, t: b.x[t] - o.go.x[t])),
}


@pytest.mark.parametrize("kind", RULES)
def test_a_rule_that_reads_another_model_is_refused_where_it_is_stated(kind: str) -> None:
    m, other = drive("mine"), drive("theirs")
    before = list(m.go.component_map())
    with pytest.raises(ModelError, match=r"phase 'go'.*reads '(go\.[xv]|mass)' of another model, 'theirs'"):
        RULES[kind](m.go, other)
    assert list(m.go.component_map()) == before
    RULES[kind](m.go, m)


def test_the_model_that_a_copy_was_made_of_is_another_one() -> None:
    m = drive("original")
    clone = m.clone()
    with pytest.raises(ModelError, match=r"of another model, 'original'"):
        clone.go.constraint(lambda b, t: b.x[t] <= m.go.x[t])
    finished(clone)
    assert copy.deepcopy(clone) is not clone


STATEMENTS: dict[str, Callable[[Any, Any], None]] = {
    "a constraint": lambda m, o: m.add_component("tie", pyo.Constraint(expr=m.go.x[0.5] == o.go.x[0.5])),
    "one of many rows": lambda m, o: m.add_component(
        "tie", pyo.Constraint(m.go.points, rule=lambda m, t: (o if t == 0.5 else m).go.x[t] <= 2)
    ),
    "an objective": lambda m, o: m.add_component("tie", pyo.Objective(expr=(m.mass - o.mass) ** 2)),
    "a pair": lambda m, o: m.add_component(
        "tie", rcp.Complementarity(expr=rcp.complements(m.mass >= 0, 2 - o.mass >= 0))
    ),
}


@pytest.mark.ipopt
@pytest.mark.parametrize("backend", ["asl", "vectorised"])
@pytest.mark.parametrize("what", STATEMENTS)
def test_a_row_that_reads_another_model_is_refused_before_the_solve(what: str, backend: str) -> None:
    m, other = finished(drive("mine")), drive("theirs")
    if what == "an objective":
        m.effort.deactivate()
    STATEMENTS[what](m, other)
    values = [variable.value for variable in other.component_data_objects(pyo.Var)]
    with pytest.raises(ModelError, match=r"tie.* of another model, 'theirs'.* one model"):
        rcp.solve(m, backend=backend)
    assert values == [variable.value for variable in other.component_data_objects(pyo.Var)]
    (error,) = (each for each in rcp.diagnose(m).errors if "another model" in each.message)
    assert error.components == ("tie",)


@pytest.mark.ipopt
def test_what_is_of_the_same_model_or_is_fixed_is_not_refused() -> None:
    m, other = finished(drive("mine")), drive("theirs")
    m.bound = pyo.Var(initialize=2.0)
    m.bound.fix()
    m.part = pyo.Block()
    m.part.seen = pyo.Reference(m.go.x)
    m.part.v = pyo.Var(initialize=0.0)
    m.part.tie = pyo.Constraint(expr=m.part.v + m.mass == m.part.seen[0.5] + m.bound)
    m.part.cost = pyo.Objective(expr=m.part.v**2)
    other.mass.fix(3.0)
    m.data = pyo.Constraint(expr=m.go.x[0.5] <= other.mass)
    m.part.cost.deactivate()
    assert rcp.solve(m).solved
    assert rcp.solve(m.clone()).solved
    m.part.cost.activate()
    assert rcp.solve(m.part).solved
    assert not [each for each in rcp.diagnose(m.part).errors if "another model" in each.message]


def test_a_part_that_is_assigned_to_the_model_later_may_read_it() -> None:
    m = drive("mine")
    part = pyo.Block(concrete=True)
    part.more = b = rcp.PhaseBlock(duration=1.0, elements=2)
    b.z = rcp.State(initial=0)
    b.ode(lambda b, t: {b.z: m.mass})
    m.part = part
    assert b.model() is m
