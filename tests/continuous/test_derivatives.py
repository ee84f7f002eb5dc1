"""Derivatives: which become expressions, derivatives of derivatives, equations with a free duration."""

from __future__ import annotations

from math import cos

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.dae import driven_tank as tank
from harness.dae import solved
from pyomo.dae import ContinuousSet, DerivativeVar
from pyomo.gdp import Disjunct

import pyrobocop_pyomo as rcp

COLLOCATION = pyo.TransformationFactory("pyrobocop.collocation")


def test_equation_of_a_disjunct_stays_there():
    m = tank(initialize=0)
    m.del_component(m.ode)
    m.on = Disjunct()
    m.on.ode = pyo.Constraint(m.t, rule=lambda d, t: d.model().dx[t] == d.model().u[t])
    COLLOCATION.apply_to(m, nfe=2)
    assert m.component("dx").ctype is pyo.Var
    assert sum(row.active for row in m.on.ode.values()) == len(m.t)


def test_bounded_or_otherwise_used_derivatives_stay_variables():
    m = tank(initialize=0)
    m.slow = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] <= 1)
    m.y = pyo.Var(m.t * pyo.Set(initialize=["a"]), initialize=0)
    m.dy = DerivativeVar(m.y, wrt=m.t, bounds=(-1, 1))
    m.other = pyo.Constraint(m.t, rule=lambda m, t: m.dy[t, "a"] == m.u[t])
    COLLOCATION.apply_to(m, nfe=2)
    assert m.dx.ctype is m.dy.ctype is pyo.Var
    assert {dy.bounds for dy in m.dy.values()} == {(-1, 1)}
    assert m.ode[2].active


@pytest.mark.casadi
def test_derivatives_of_derivatives_and_of_third_order():
    m = pyo.ConcreteModel(name="jerk")
    m.t = ContinuousSet(initialize=np.linspace(0, 1, 4))
    m.x, m.y = pyo.Var(m.t, initialize=0), pyo.Var(m.t)
    m.dx, m.jerk = DerivativeVar(m.x), DerivativeVar(m.x, wrt=(m.t, m.t, m.t))
    m.push = pyo.Constraint(m.t, rule=lambda m, t: m.jerk[t] == 6)
    m.v = DerivativeVar(m.y)
    m.a = DerivativeVar(m.v)
    m.swing = pyo.Constraint(m.t, rule=lambda m, t: m.a[t] == -m.y[t])
    for variable, start in ((m.x, 0), (m.dx, 0), (m.y, 1), (m.v, 0)):
        variable[0].fix(start)
    m.x[1].fix(1)
    COLLOCATION.apply_to(m, nfe=6)
    solved(m)
    assert m.x[0.5].value == pytest.approx(0.125)
    assert m.y[1].value == pytest.approx(cos(1), abs=1e-7)
    trajectory = rcp.dae_trajectory(m, m.t)
    assert set(trajectory.states) == {"x", "dx", "t_collocation.x_derivative_2", "y", "v"}
    assert set(trajectory.signals) == {"jerk", "a"}
    assert trajectory(0.2)["dx"] == pytest.approx(3 * 0.2**2)


@pytest.mark.casadi
def test_free_duration_as_a_factor_of_the_equations():
    m = pyo.ConcreteModel(name="quick")
    m.t = ContinuousSet(bounds=(0, 1))
    m.duration = pyo.Var(bounds=(0.1, 10), initialize=3)
    m.x, m.v = pyo.Var(m.t, initialize=lambda m, t: t), pyo.Var(m.t, initialize=0.3)
    m.force = pyo.Var(m.t, bounds=(-1, 1), initialize=0)
    m.dx, m.dv = DerivativeVar(m.x), DerivativeVar(m.v)
    m.move = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.duration * m.v[t])
    m.newton = pyo.Constraint(m.t, rule=lambda m, t: m.dv[t] == m.duration * m.force[t])
    for variable, start, end in ((m.x, 0, 1), (m.v, 0, 0)):
        variable[0].fix(start)
        variable[1].fix(end)
    m.cost = pyo.Objective(expr=m.duration)
    COLLOCATION.apply_to(m, nfe=20)
    assert solved(m).duration.value == pytest.approx(2, abs=1e-6)
    assert rcp.dae_trajectory(m, m.t).parameters == {"duration": m.duration.value}
