"""Values at points without a stage: what equations determine there, what is fixed there, and what is shown."""

from __future__ import annotations

from math import exp

import pyomo.environ as pyo
import pytest
from harness.dae import solved
from pyomo.dae import ContinuousSet, DerivativeVar, Integral

import pyrobocop_pyomo as rcp

OURS = pyo.TransformationFactory("pyrobocop.collocation")
SCHEMES = ["radau", "gauss", "lobatto"]


def regulator(**bounds):
    """A control, what depends on it, and what depends on the state alone."""
    m = pyo.ConcreteModel(name="regulator")
    m.t = ContinuousSet(bounds=(0, 2))
    m.x, m.y, m.power = pyo.Var(m.t, initialize=1), pyo.Var(m.t, bounds=(0, None)), pyo.Var(m.t)
    m.u = pyo.Var(m.t, initialize=0, **bounds)
    m.dx = DerivativeVar(m.x)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.u[t])
    m.square = pyo.Constraint(m.t, rule=lambda m, t: m.y[t] == m.x[t] ** 2)
    m.work = pyo.Constraint(m.t, rule=lambda m, t: m.power[t] == m.u[t] * m.x[t])
    m.effort = Integral(m.t, rule=lambda m, t: m.y[t] + m.u[t] ** 2)
    m.cost = pyo.Objective(expr=m.effort)
    return m


@pytest.mark.casadi
@pytest.mark.parametrize("derivatives", ["substitute", "keep"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_every_equation_holds_at_every_point(scheme, derivatives):
    m = regulator(bounds=(-0.6, 1))
    m.x[0].fix(1)
    OURS.apply_to(m, nfe=4, scheme=scheme, derivatives=derivatives)
    solved(m)
    for t in m.t:
        assert m.dx[t].value == pytest.approx(m.u[t].value, abs=1e-8)
        assert m.y[t].value == pytest.approx(m.x[t].value ** 2, abs=1e-8)
        assert m.power[t].value == pytest.approx(m.u[t].value * m.x[t].value, abs=1e-8)
    points = rcp.dae_trajectory(m, m.t).points
    if scheme != "lobatto":
        assert m.u[0].value == pytest.approx(m.u[points[0]].value)


@pytest.mark.casadi
def test_shown_values_change_no_answer():
    """Without anything at the start, the answer is the same."""
    found = []
    for skips in (False, True):
        m = regulator(bounds=(-0.6, 1))
        m.x[0].fix(1)
        if skips:
            for row in (m.ode, m.square, m.work):
                del row[0]
        OURS.apply_to(m, nfe=4)
        solved(m)
        found.append([pyo.value(m.cost), *(x.value for x in m.x.values())])
    assert found[0] == pytest.approx(found[1], abs=1e-8)


@pytest.mark.casadi
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("end", [0, 2])
def test_fixed_algebraic_is_a_condition_on_the_state(scheme, end):
    m = regulator()
    m.u.fix(0.5)
    m.y[end].fix(4)
    OURS.apply_to(m, nfe=3, scheme=scheme)
    solved(m)
    assert abs(m.x[end].value) == pytest.approx(2)
    assert m.x[2].value - m.x[0].value == pytest.approx(1)


@pytest.mark.casadi
@pytest.mark.parametrize("scheme", ["radau", "gauss"])
def test_row_of_its_own_for_an_algebraic_at_the_start(scheme):
    m = regulator()
    m.u.fix(0.5)
    m.given = pyo.Constraint(expr=m.y[0] == 4)
    OURS.apply_to(m, nfe=3, scheme=scheme)
    assert abs(solved(m).x[0].value) == pytest.approx(2)


@pytest.mark.casadi
def test_control_that_is_fixed_at_the_start_alone():
    found = []
    for fixed in (False, True):
        m = regulator()
        m.x[0].fix(1)
        if fixed:
            m.u[0].fix(0.7)
        OURS.apply_to(m, nfe=4)
        found.append(pyo.value(solved(m).cost))
    assert m.u[0].value == m.dx[0].value == 0.7
    assert found[0] == pytest.approx(found[1], abs=1e-9)


@pytest.mark.casadi
@pytest.mark.parametrize("scheme", ["radau", "gauss"])
def test_bounds_that_do_not_allow_for_the_neighbours_value(scheme):
    """Then the equations hold at the start with a value of its own within the bounds, and nothing else knows of it."""
    m = regulator(bounds=lambda m, t: (-t, t))
    m.x[0].fix(1)
    OURS.apply_to(m, nfe=3, scheme=scheme)
    solved(m)
    assert m.u[0].value == pytest.approx(0, abs=1e-9)
    assert m.dx[0].value == pytest.approx(0, abs=1e-9)
    assert m.x[m.t.at(2)].value < 1 - 1e-3


@pytest.mark.casadi
def test_column_with_an_algebraic_that_both_streams_hold():
    """The equations of the second stream hold at the first point, with the flux there."""
    m = pyo.ConcreteModel(name="column")
    m.z, m.t = ContinuousSet(bounds=(0, 1)), ContinuousSet(bounds=(0, 8))
    m.up, m.down, m.flux = (pyo.Var(m.z, m.t, initialize=0.5) for _ in range(3))
    m.up_z, m.down_z = DerivativeVar(m.up, wrt=m.z), DerivativeVar(m.down, wrt=m.z)
    m.up_t, m.down_t = DerivativeVar(m.up, wrt=m.t), DerivativeVar(m.down, wrt=m.t)
    skip = pyo.Constraint.Skip
    m.exchange = pyo.Constraint(m.z, m.t, rule=lambda m, z, t: m.flux[z, t] == m.up[z, t] - m.down[z, t])
    m.first = pyo.Constraint(
        m.z, m.t, rule=lambda m, z, t: skip if z == 0 else m.up_t[z, t] == -m.up_z[z, t] - m.flux[z, t]
    )
    m.second = pyo.Constraint(
        m.z, m.t, rule=lambda m, z, t: skip if z == 1 else m.down_t[z, t] == m.down_z[z, t] + m.flux[z, t]
    )
    m.ends = pyo.Constraint(m.t, rule=lambda m, t: m.up[0, t] == 1)
    m.others = pyo.Constraint(m.t, rule=lambda m, t: m.down[1, t] == 0)
    m.start = pyo.Constraint(m.z, rule=lambda m, z: skip if z == 0 else m.up[z, 0] == exp(-z))
    m.begin = pyo.Constraint(m.z, rule=lambda m, z: skip if z == 1 else m.down[z, 0] == 0)
    m.cost = pyo.Objective(expr=0)
    OURS.apply_to(m, wrt=m.z, nfe=2, ncp=2, scheme="gauss")
    OURS.apply_to(m, wrt=m.t, nfe=4, ncp=2)
    solved(m)
    assert all(flux.value is not None for flux in m.flux.values())
    # In the steady state up - down is the same everywhere: up = 1 - z / 2, down = (1 - z) / 2.
    assert m.up[1, 8].value == pytest.approx(0.5, abs=1e-2)
    assert m.down[0, 8].value == pytest.approx(0.5, abs=1e-2)
