"""A rule of a pyomo.dae model is called a few times for all points, and its rows are those that it states itself."""

from __future__ import annotations

import pyomo.dae as dae
import pyomo.environ as pyo
import pytest

from pyrobocop_pyomo.modeling.expressions import same_expression


def states(m, t, i):
    if t == 0 and i == 1:
        return pyo.Constraint.Skip
    x, s = m.x[t], pyo.sin(m.angle[t])
    first = m.gain * x * s - x / 0.75 + (m.u[t] + 2.0 + x**2 - s) / (1.0 + x**2) + m.shift[t] * x
    second = -x * 0.5 + m.angle[t] + m.u[t] * t
    return (m.dx[t] == first, m.dangle[t] == second)[i]


def limits(m, t):
    if 1.0 < t <= 2.0:
        return pyo.inequality(-1.0, m.u[t] + m.e[t], 0.5)
    return m.u[t] * m.x[t] <= 1 + t if t != 3 else (0.0, m.u[t], 5.0)


def looks_up(m, t):
    return m.x[t] + {0.0: 1.0}.get(t, 2.0) >= -3


def model(calls):
    def counted(rule):
        def ask(m, *index):
            calls[rule.__name__] = calls.get(rule.__name__, 0) + 1
            return rule(m, *index)

        return ask

    m = pyo.ConcreteModel()
    m.t = dae.ContinuousSet(initialize=[0, 1, 2, 3])
    m.x, m.angle, m.u = pyo.Var(m.t), pyo.Var(m.t), pyo.Var(m.t)
    m.dx, m.dangle = dae.DerivativeVar(m.x), dae.DerivativeVar(m.angle)
    m.gain = pyo.Param(initialize=3.0, mutable=True)
    m.shift = pyo.Param(m.t, initialize=0.0, default=1.0)
    m.e = pyo.Expression(m.t, rule=counted(lambda m, t: m.x[t] * m.angle[t]))
    m.states = pyo.Constraint(m.t, [0, 1], rule=counted(states))
    m.limits = pyo.Constraint(m.t, rule=counted(limits))
    m.looks_up = pyo.Constraint(m.t, rule=counted(looks_up))
    calls.clear()
    return m


def test_rows_are_what_the_rule_says_at_each_point():
    calls: dict[str, int] = {}
    m = model(calls)
    pyo.TransformationFactory("pyrobocop.collocation").apply_to(m, nfe=30, derivatives="keep")
    assert calls["looks_up"] == 88  # it has to know the time
    assert calls["states"] <= 2 * 2 + 1  # once more at t = 0
    assert calls["<lambda>"] <= 2
    assert calls["limits"] <= 2 * 3 + 1  # before, between and after, and at t = 3 where it compares nothing else
    assert len(m.states) == 2 * 91 - 1
    for (t, i), row in m.states.items():
        left, right = states(m, t, i).args
        assert row.expr.args[0] is left
        assert same_expression(row.expr.args[1], right)
    for t, row in m.limits.items():
        stated = pyo.Constraint(expr=limits(m, t))
        stated.construct()
        assert [str(part) for part in row.to_bounded_expression()] == [
            str(part) for part in stated.to_bounded_expression()
        ]
    for t in m.t:
        assert str(m.e[t].expr) == str(m.x[t] * m.angle[t])


def test_a_rule_that_fails_names_its_point():
    m = pyo.ConcreteModel()
    m.t = dae.ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.t)
    m.dx = dae.DerivativeVar(m.x)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.x[t] * (1.0 if t in (0, 1) else 1 / 0))
    with pytest.raises(Exception, match="its rule failed at the new point"):
        pyo.TransformationFactory("pyrobocop.collocation").apply_to(m, nfe=10)
