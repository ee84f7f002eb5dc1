"""Six models of plain pyomo.dae against their known answers, and the orders of convergence."""

from math import cos

import numpy as np
import pyomo.environ as pyo
import pytest
from catalogue.dae_models import CASES, oscillator, rectifier, two_phases
from harness.convergence import observed_order
from harness.dae import driven_tank, free_variables, solved
from harness.phases import one_phase
from pyomo.dae import ContinuousSet, DerivativeVar, Integral
from pyomo.gdp import Disjunct

import pyrobocop_pyomo as rcp

COLLOCATION = pyo.TransformationFactory("pyrobocop.collocation")

# Largest error of the states, and error of the quantity, with seven elements of four stages.
REACHED = {
    "reactor, index 1": (1e-8, 3e-9),
    "estimation": (3e-9, 5e-9),
    "two sets": (1e-10, 1e-10),
    "second derivative": (3e-6, 3e-6),
    "block per time": (1e-7, 5e-9),
    "complementarity": (5e-5, 5e-5),
}


@pytest.mark.casadi
@pytest.mark.parametrize("scheme", ["LAGRANGE-RADAU", "LAGRANGE-LEGENDRE"])
@pytest.mark.parametrize("name", CASES)
def test_known_answers(name, scheme):
    """More accurately than by pyomo.dae, where that does not reach the same digits."""
    m = CASES[name].build()
    COLLOCATION.apply_to(m, nfe=7, ncp=4, scheme=scheme)
    state, quantity = CASES[name].errors(solved(m))
    assert state < REACHED[name][0]
    assert quantity < REACHED[name][1]
    if name in ("reactor, index 1", "estimation", "two sets"):
        theirs = CASES[name].build()
        pyo.TransformationFactory("dae.collocation").apply_to(theirs, nfe=7, ncp=4, scheme=scheme)
        their_state, their_quantity = CASES[name].errors(solved(theirs))
        assert state < their_state / 2
        assert quantity < their_quantity / 2


@pytest.mark.casadi
def test_pairs_of_this_package_know_element_and_weight():
    m = rectifier(rcp.Complementarity, rcp.complements)
    COLLOCATION.apply_to(m, nfe=6, ncp=3)
    pairs = rcp.active_pairs(m)
    assert len(pairs) == 19
    assert {pair.group for pair in pairs} == set(range(6))
    inside = [pair.weight for pair in pairs if pair.source.index() != 0]
    assert sum(inside) == pytest.approx(m.t.last())
    assert CASES["complementarity"].errors(solved(m, strategies=rcp.Strategy(grouping="element")))[0] < 1e-3


@pytest.mark.parametrize("scheme", ["radau", "gauss", "lobatto", "explicit_euler", "trapezoid"])
@pytest.mark.parametrize("name", ["reactor, index 1", "second derivative", "block per time"])
def test_nothing_is_left_undetermined(name, scheme):
    m = CASES[name].build()
    COLLOCATION.apply_to(m, nfe=4, scheme=scheme)
    assert free_variables(m) == 0


@pytest.mark.parametrize("scheme", ["radau", "gauss"])
def test_two_sets_leave_the_controls_at_the_points_free(scheme):
    m = two_phases()
    COLLOCATION.apply_to(m, nfe=4, ncp=3, scheme=scheme)
    assert free_variables(m) == 2 * 4 * 3


# -------------------------------------------------------------------- orders


@pytest.mark.casadi
@pytest.mark.parametrize(
    ("scheme", "stages", "meshes"),
    [("radau", 2, (16, 32, 64)), ("radau", 3, (10, 14, 20)), ("gauss", 1, (32, 64, 128)), ("gauss", 2, (16, 24, 36))],
)
def test_states_and_integrals_converge_with_the_order_of_the_scheme(scheme, stages, meshes):
    errors = []
    for elements in meshes:
        m = oscillator()
        COLLOCATION.apply_to(m, nfe=elements, ncp=stages, scheme=scheme)
        errors.append(CASES["second derivative"].errors(solved(m)))
    expected = rcp.schemes.find_scheme(scheme, stages).order
    for column in zip(*errors, strict=True):
        assert observed_order(meshes, column, rounding_floor=1e-13) == pytest.approx(expected, abs=0.25)


# -------------------------------------------------------------------- the same as a phase


def regulator():
    m = driven_tank((0, 3), initialize=0, bounds=(-0.6, 5))
    m.del_component(m.ode)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.u[t] - 0.2 * m.x[t] ** 3)
    m.effort = Integral(m.t, rule=lambda m, t: m.x[t] ** 2 + m.u[t] ** 2)
    m.cost = pyo.Objective(expr=m.effort)
    return m


@pytest.mark.casadi
@pytest.mark.parametrize("scheme", ["radau", "gauss", "hermite_simpson"])
def test_optimum_is_that_of_a_phase(scheme):
    boundaries = [0, 0.4, 0.5, 1.3, 2.2, 3]
    m = regulator()
    COLLOCATION.apply_to(m, mesh=boundaries, scheme=scheme)
    solved(m)

    n, b = one_phase("phase", model="phase", duration=3, mesh=boundaries, scheme=scheme)
    b.x, b.u = rcp.State(initial=1, initial_guess=1), rcp.Control(bounds=(-0.6, 5))
    b.ode(lambda b, t: {b.x: b.u[t] - 0.2 * b.x[t] ** 3})
    n.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    solved(n)

    assert pyo.value(m.cost) == pytest.approx(pyo.value(n.cost), abs=1e-10)
    ours, theirs = rcp.dae_trajectory(m, m.t), b.trajectory()
    times = [0.1, 0.45, 1.0, 2.9]
    assert ours(times)["x"] == pytest.approx(theirs(times)["x"], abs=1e-7)
    assert ours(times)["u"] == pytest.approx(theirs(times)["u"], abs=1e-5)
    assert ours.rates["x"] == pytest.approx(theirs.rates["x"], abs=1e-6)
    assert ours.signals["dx"] == pytest.approx(ours.rates["x"])


@pytest.mark.casadi
def test_a_piecewise_function_gets_the_new_points():
    """The cheapest way from 1 to 0 where |x| costs: x = 2.5 (s - t)^2 until s = 0.4^0.5, which costs 5/3 0.4^1.5."""
    m = pyo.ConcreteModel(name="piecewise")
    m.t = ContinuousSet(bounds=(0, 1))
    m.x, m.u, m.price = pyo.Var(m.t, bounds=(-2, 2)), pyo.Var(m.t), pyo.Var(m.t)
    m.dx = DerivativeVar(m.x)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.u[t])
    m.x[0].fix(1)
    m.convex = pyo.Piecewise(m.t, m.price, m.x, pw_pts=[-2.0, 0.0, 2.0], f_rule=[2.0, 0.0, 2.0], pw_constr_type="LB")
    m.total = Integral(m.t, rule=lambda m, t: m.price[t] + 0.1 * m.u[t] ** 2)
    m.cost = pyo.Objective(expr=m.total)
    COLLOCATION.apply_to(m, nfe=10)
    solved(m)
    assert len(m.convex) == len(m.t)
    assert pyo.value(m.cost) == pytest.approx(5 / 3 * 0.4**1.5, rel=1e-4)


@pytest.mark.casadi
@pytest.mark.parametrize("scheme", ["radau", "gauss", "lobatto"])
def test_a_pair_holds_at_the_first_point_too(scheme):
    """Vapour leaves at the boiling point only; just after the start it does, and at the start it does not."""
    m = pyo.ConcreteModel(name="flash")
    m.t = ContinuousSet(bounds=(0, 10))
    m.T, m.V = pyo.Var(m.t, initialize=300), pyo.Var(m.t, bounds=(0, None), initialize=0.5)
    m.dT = DerivativeVar(m.T)
    m.heat = pyo.Constraint(m.t, rule=lambda m, t: m.dT[t] == 40 - 8 * m.V[t])
    m.boil = rcp.Complementarity(m.t, rule=lambda m, t: rcp.complements(m.V[t] >= 0, 373 - m.T[t] >= 0))
    m.T[0].fix(370)
    m.cost = pyo.Objective(expr=-m.T[10])
    COLLOCATION.apply_to(m, nfe=5, scheme=scheme)
    assert rcp.solve(m, progress=False).solved
    assert m.V[0].value == pytest.approx(0, abs=1e-5)
    assert m.dT[0].value == pytest.approx(40, abs=1e-4)


# --------------------------------------------------------------------
# Derivatives: which become expressions, derivatives of derivatives, equations with a free duration.


def test_equation_of_a_disjunct_stays_there():
    m = driven_tank(initialize=0)
    m.del_component(m.ode)
    m.on = Disjunct()
    m.on.ode = pyo.Constraint(m.t, rule=lambda d, t: d.model().dx[t] == d.model().u[t])
    COLLOCATION.apply_to(m, nfe=2)
    assert m.component("dx").ctype is pyo.Var
    assert sum(row.active for row in m.on.ode.values()) == len(m.t)


def test_bounded_or_otherwise_used_derivatives_stay_variables():
    m = driven_tank(initialize=0)
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
