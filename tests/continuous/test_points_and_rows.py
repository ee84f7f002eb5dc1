"""Meshes, what the user set beforehand, and where rows hold."""

import pickle
from math import exp, pi, sin

import pyomo.environ as pyo
import pytest
from catalogue.dae_models import CASES, HEATING, reactor
from harness.dae import driven_tank as tank
from harness.dae import solved
from pyomo.dae import ContinuousSet, DerivativeVar, Integral

import pyrobocop_pyomo as rcp

COLLOCATION = pyo.TransformationFactory("pyrobocop.collocation")


# -------------------------------------------------------------------- meshes


def test_boundaries_are_never_rounded():
    boundaries = [0, 1 / 7, 2 / 3, pi / 3, 2]
    m = tank((0, 1 / 3, 2))
    COLLOCATION.apply_to(m, wrt=m.t, mesh=boundaries)
    assert m.t.get_finite_elements() == sorted({*boundaries, 1 / 3})
    grid = rcp.schemes.Grid(rcp.schemes.radau(3), rcp.schemes.Mesh.given(sorted({*boundaries, 1 / 3})))
    assert tuple(m.t) == grid.times


def test_points_of_the_set_are_boundaries_and_the_rest_is_even(caplog):
    m = tank((0, 0.5, 2))
    COLLOCATION.apply_to(m, nfe=4)
    assert m.t.get_finite_elements() == [0, 0.5, 1, 1.5, 2]
    m = tank((0, 0.5, 2))
    COLLOCATION.apply_to(m, nfe=1)
    assert m.t.get_finite_elements() == [0, 0.5, 2]
    assert "'t': has 3 points of its own, hence 2 elements instead of 1" in caplog.text


@pytest.mark.parametrize(
    ("name", "known"),
    [("LAGRANGE-RADAU", "radau(3)"), ("LAGRANGE-LEGENDRE", "gauss(3)"), ("lobatto", "lobatto(3)")],
)
def test_names_of_schemes(name, known):
    m = tank(initialize=0)
    COLLOCATION.apply_to(m, scheme=name, ncp=3)
    assert rcp.dae_trajectory(m, m.t).grid.scheme.name == known


# -------------------------------------------------------------------- what the user set beforehand


def test_bounds_reach_every_point():
    m = tank(initialize=0, domain=pyo.NonNegativeReals)
    m.x.setub(5)
    m.u.setub(3)
    m.u[2].setlb(1)  # at one point only: a condition there
    COLLOCATION.apply_to(m, nfe=4)
    assert {x.ub for x in m.x.values()} == {5}
    assert {u.ub for u in m.u.values()} == {3}
    assert {u.lb for t, u in m.u.items() if t < 2} == {0}
    assert m.u[2].lb == 1


def test_bounds_in_time_are_asked_at_every_point():
    m = tank(initialize=0, bounds=lambda m, t: (-t, t + 1))
    COLLOCATION.apply_to(m, nfe=4)
    assert all(u.bounds == (-t, t + 1) for t, u in m.u.items())


def test_fixing_a_control_fixes_it_everywhere():
    m = tank()
    m.u.fix(0.3)
    COLLOCATION.apply_to(m, nfe=4)
    assert all(u.fixed and u.value == 0.3 for u in m.u.values())
    m = tank(initialize=lambda m, t: sin(t))
    m.u.fix()
    COLLOCATION.apply_to(m, nfe=4)
    assert all(u.fixed and u.value == sin(t) for t, u in m.u.items())


def test_fixing_a_state_at_both_ends_is_a_boundary_condition():
    m = tank()
    m.x.fix(1)
    COLLOCATION.apply_to(m, nfe=4)
    assert [t for t, x in m.x.items() if x.fixed] == [0, 2]


def test_guesses_are_those_of_the_declaration_or_interpolated():
    m = tank(initialize=lambda m, t: t**2)
    m.x[0].value, m.x[2].value = 5, 9
    COLLOCATION.apply_to(m, nfe=4)
    assert all(m.u[t].value == t**2 for t in m.t if t > 0)
    assert all(x.value == pytest.approx(5 + 2 * t) for t, x in m.x.items())


def test_deactivated_components_stay_so():
    m = tank(initialize=0)
    m.limit = pyo.Constraint(m.t, rule=lambda m, t: m.x[t] <= 3)
    m.limit.deactivate()
    m.rows = pyo.Constraint(m.t, rule=lambda m, t: m.x[t] <= 3)
    m.rows[0].deactivate()
    m.rows[2].deactivate()
    m.b = pyo.Block(m.t, rule=lambda b, t: setattr(b, "row", pyo.Constraint(expr=b.model().x[t] >= 0)))
    m.b.deactivate()
    COLLOCATION.apply_to(m, nfe=4)
    assert not any(row.active for component in (m.limit, m.rows, m.b) for row in component.values())
    assert len(m.rows) == len(m.b) == len(m.t)


# -------------------------------------------------------------------- where rows hold


@pytest.mark.parametrize(("scheme", "inner"), [("radau", 9), ("gauss", 9), ("lobatto", 7)])
def test_where_rows_hold(scheme, inner):
    m = tank(initialize=0)
    m.z, m.power = pyo.Var(m.t, initialize=0), pyo.Var(m.t, initialize=0)
    m.slow = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] <= 100)  # so that it stays a variable
    m.path = pyo.Constraint(m.t, rule=lambda m, t: m.x[t] <= 3)
    m.same = pyo.Constraint(m.t, rule=lambda m, t: m.x[t] ** 2 == 4)
    m.other = pyo.Constraint(m.t, rule=lambda m, t: m.z[t] == m.x[t])
    m.work = pyo.Constraint(m.t, rule=lambda m, t: m.power[t] == m.u[t] * m.x[t])
    m.low = pyo.Constraint(m.t, rule=lambda m, t: m.z[t] <= 3)
    m.much = pyo.Constraint(m.t, rule=lambda m, t: m.power[t] <= 3)
    m.ends = pyo.Constraint(m.t, rule=lambda m, t: m.x[t] >= 1 if t in (0, 2) else pyo.Constraint.Skip)
    m.last = pyo.Constraint(m.t, rule=lambda m, t: m.x[t] == 1 if t == 2 else pyo.Constraint.Skip)
    COLLOCATION.apply_to(m, nfe=3, ncp=3, scheme=scheme)
    points = set(rcp.dae_trajectory(m, m.t).points) if scheme == "lobatto" else set(m.t_collocation.dx)
    if scheme == "lobatto":
        assert len(points) == inner

    def holds(component):
        return {t for t, row in component.items() if row.active}

    assert holds(m.path) == set(m.t)
    assert holds(m.same) == points | {0}
    assert holds(m.other) == holds(m.low) == set(m.t)  # the states determine z
    assert holds(m.ode) == holds(m.work) == set(m.t)  # they give dx and power, by way of u
    assert holds(m.much) == points
    assert holds(m.ends) == {0, 2}
    assert holds(m.last) == {2}
    assert not any(m.u[t].fixed or m.dx[t].fixed for t in m.t)


# --------------------------------------------------------------------
# Clones, pickles, and create_using.


# -------------------------------------------------------------------- copies


def decaying():
    m = pyo.ConcreteModel(name="decay")
    m.t = ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.t, initialize=1)
    m.dx = DerivativeVar(m.x)
    m.ode = pyo.Constraint(m.t, rule=_decay)
    m.x[0].fix(1)
    m.area = Integral(m.t, rule=_x)
    m.cost = pyo.Objective(expr=m.area)
    return m


def _decay(m, t):
    return m.dx[t] == -m.x[t]


def _x(m, t):
    return m.x[t]


@pytest.mark.casadi
@pytest.mark.parametrize("copied", [lambda m: m.clone(), lambda m: pickle.loads(pickle.dumps(m))])
def test_clones_and_pickles_are_models_of_their_own(copied):
    m = decaying()
    COLLOCATION.apply_to(m, nfe=4)
    n = copied(m)
    n.x[0].fix(2)
    solved(n)
    assert m.x[1].value == 1
    assert n.x[1].value == pytest.approx(2 * exp(-1), abs=1e-6)
    assert rcp.dae_trajectory(n, n.t).rates["x"][-1] == pytest.approx(-2 * exp(-1), abs=1e-4)
    assert len(m.t) == 13
    assert m.x._derivative[("t",)]() in (m.dx, m.find_component("t_collocation.replaced.dx"))


@pytest.mark.casadi
def test_create_using_leaves_the_model_alone():
    m = reactor()
    n = COLLOCATION.create_using(m, wrt=m.t, nfe=4)
    assert list(m.t) == [0, HEATING]
    assert m.dtotal.ctype is DerivativeVar
    assert m.product.ctype is Integral
    assert CASES["reactor, index 1"].errors(solved(n))[0] < 1e-4
