"""A rule is asked once: its template says on the grid and between its points what the rule itself would say."""

import math
from collections import Counter
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from harness.small_problems import every_derivative
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.modeling.expressions import same_expression

DATA = {0.0: 1.0}


MODELS: list[Any] = []  # Pyomo holds parents by weak references


def phase(**options: Any) -> Any:
    m = pyo.ConcreteModel()
    MODELS[:] = [*MODELS[-1:], m]
    m.p = b = rcp.PhaseBlock(**{"duration": 1.5, "elements": 6, **options})
    b.x, b.v = rcp.State(initial=1.0), rcp.State(initial=0.0)
    b.z, b.u = rcp.Algebraic(), rcp.Control(bounds=(-3, 3))
    b.k = rcp.Parameter(initial_guess=0.3)
    b.weights = pyo.Param(b.points, initialize=lambda _, t: 1.0 + t)
    b.energy = pyo.Expression(b.points, rule=lambda b, t: b.v[t] ** 2 + b.x[t])
    return b


TABLE = rcp.Table([-9.0, 0.0, 1.0, 9.0], [0.0, 1.0, 0.5, 0.0])

# What is one formula for all times, and what has to know the time.
TEMPLATES: dict[str, Any] = {
    "variables": lambda b, t: b.x[t] * b.u[t] - b.k * b.v[t] ** 2,
    "a bare variable": lambda b, t: b.v[t],
    "functions": lambda b, t: pyo.sin(b.x[t]) / (2 + pyo.cos(b.v[t])) + abs(b.u[t]) - pyo.exp(-b.x[t]),
    "the time": lambda b, t: t * b.u[t] + pyo.sin(3 * t) - 2**t,
    "a condition": lambda b, t: pyo.Expr_if(b.x[t] <= 0.5 + t, b.u[t], -b.v[t]),
    "a named expression": lambda b, t: b.energy[t] * 2,
    "data over time": lambda b, t: b.weights[t] * b.u[t],
    "a table": lambda b, t: TABLE(t) + TABLE(b.x[t]),
    "a delay": lambda b, t: b.u.delayed(t, 0.0) + b.time_at(t),
    "a fixed time": lambda b, t: b.x[t] - b.x.at(0.5) + b.v.at_start,
    "a number": lambda b, t: 3,
    "through the model": lambda b, t: b.model().p.x[t],
}
BY_POINT: dict[str, Any] = {
    "a branch": lambda b, t: b.u[t] if t < 0.5 else -b.u[t],
    "a dictionary": lambda b, t: DATA.get(t, 2.0) * b.u[t],
    "a set": lambda b, t: b.u[t] if t in {0.0, 1.5} else b.v[t],
    "a text": lambda b, t: len(f"{t}") * b.u[t],
    "a number of Python": lambda b, t: float(t) * b.u[t],
    "its place": lambda b, t: b.points.ord(t) * b.u[t],
    "the one before": lambda b, t: b.x[b.time.prev(t)],
    "a value": lambda b, t: pyo.value(b.k) * b.x[t],
}


def counted(rule: Any, calls: Counter[str]) -> Any:
    def asked(b: Any, t: Any) -> Any:
        calls["rule"] += 1
        return rule(b, t)

    return asked


@pytest.mark.parametrize("horizon", [1.5, rcp.Duration(bounds=(1, 2))], ids=["fixed", "free"])
@pytest.mark.parametrize("name", TEMPLATES)
def test_a_template_gives_the_rows_of_the_rule_and_asks_it_twice(name: str, horizon: Any) -> None:
    b, calls, costs = phase(duration=horizon), Counter[str](), Counter[str]()
    b.ode(counted(lambda b, t: {b.x: TEMPLATES[name](b, t)}, calls), name="said")
    b.integral(counted(TEMPLATES[name], costs))
    assert calls["rule"] == costs["rule"] == 2
    assert b.record.statements[0].rule.is_template(b)
    rng = np.random.default_rng(5)
    for variable in b.component_data_objects(pyo.Var):
        variable.set_value(rng.uniform(0.5, 2.0), skip_validation=True)
    for t in b.points:
        stated = TEMPLATES[name](b, b.record.index_for_rule(b, t, "the rule"))
        assert pyo.value(b.record.rates["x"][t]) == pytest.approx(pyo.value(stated), rel=1e-15)


@pytest.mark.parametrize("name", sorted(set(BY_POINT) - {"a value"}))
def test_a_rule_that_has_to_know_the_time_is_asked_at_each_point(name: str) -> None:
    b = phase()
    b.ode(lambda b, t: {b.x: BY_POINT[name](b, t)})
    assert not b.record.statements[0].rule.is_template(b)
    for t in b.points:
        assert same_expression(b.record.rates["x"][t], BY_POINT[name](b, t))


def test_a_rule_that_says_something_else_each_time_is_no_template() -> None:
    b, count = phase(), iter(range(10_000))
    b.ode(lambda b, t: {b.x: next(count) * b.u[t]})
    assert not b.record.statements[0].rule.is_template(b)


FORMS: dict[str, Any] = {
    "ode": lambda b, t: {b.x: b.v[t], "v": b.u[t]},
    "residual": lambda b, t: [b.z[t] == b.x[t] ** 2, b.derivative(b.x)[t] - b.v[t]],
    "constraint": lambda b, t: {"box": (-1, b.x[t], 1), "sum": b.x[t] + b.v[t] <= 2 + t, "row": b.x[t] >= 0},
    "complementarity": lambda b, t: [rcp.complements(b.z[t] >= 0, b.x[t] - b.v[t] >= 0)],
    "constraint_at_boundaries": lambda b, t: pyo.inequality(-1, b.x[t], 1),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_result_is_kept(form: str) -> None:
    by_template, by_point, calls = phase(), phase(), Counter[str]()
    for b in (by_template, by_point):
        if form == "residual":
            b.ode(lambda b, t: {b.x: b.v[t]})

    def knows_the_time(b: Any, t: Any) -> Any:
        float(t)
        return FORMS[form](b, t)

    getattr(by_template, form)(counted(FORMS[form], calls), name="said")
    getattr(by_point, form)(knows_the_time, name="said")
    assert calls["rule"] == 2
    rows = [
        [str(row.expr) for row in b.component_data_objects(pyo.Constraint)]
        + [str([*map(str, pair.args)]) for pair in b.component_data_objects(rcp.Complementarity)]
        for b in (by_template, by_point)
    ]
    assert rows[0] == rows[1] != []


def test_step_maps_are_templates_with_the_states_before() -> None:
    b, calls = phase(scheme="implicit_euler"), Counter[str]()

    @b.step_map
    def step(b: Any, t: Any, previous: Any) -> Any:
        calls["rule"] += 1
        return {b.x: previous.x + 0.1 * b.v[t] * previous.v}

    assert calls["rule"] == 2
    before = b.time.first()
    for t in b.points:
        variables = {id(variable) for variable in identify_variables(b.x_step[t].body)}
        assert variables == {id(item) for item in (b.x[t], b.x[before], b.v[t], b.v[before])}
        before = t


@every_derivative
def test_a_choice_by_the_time_is_the_side_that_holds_at_each_point(derivatives):
    m, b = one_phase("b", duration=2.0, elements=20, x=rcp.State(initial=0), u=rcp.Control(bounds=(-1, 1)))
    b.ode(
        lambda b, t: {
            b.x: pyo.Expr_if(IF=pyo.inequality(None, t, 1.0), THEN=1.0 + b.u[t], ELSE=b.u[t] - pyo.sin(b.x[t]))
        }
    )
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    assert rcp.solve(m, backend=derivatives, progress=False).solved
    assert b.x[1.0].value == pytest.approx(1.0, abs=1e-7)
    # From there the exact motion is tan(x / 2) = tan(1 / 2) exp(1 - t).
    assert b.x[2.0].value == pytest.approx(2 * math.atan(math.tan(0.5) * math.exp(-1.0)), abs=1e-7)
