"""Mixed indices, blocks, several sets, references, disjuncts, tools of Pyomo."""

from io import StringIO
from math import exp, pi, sin

import pyomo.environ as pyo
import pytest
from catalogue.dae_models import CASES, rectifier, two_phases
from harness.dae import driven_tank as tank
from harness.dae import free_variables, solved
from pyomo.common.timing import report_timing
from pyomo.contrib.mpc import DynamicModelInterface
from pyomo.dae import ContinuousSet, DerivativeVar, Integral
from pyomo.mpec import Complementarity, complements
from pyomo.util.check_units import assert_units_consistent

import pyrobocop_pyomo as rcp

COLLOCATION = pyo.TransformationFactory("pyrobocop.collocation")


# -------------------------------------------------------------------- indices, blocks, sets


@pytest.mark.casadi
@pytest.mark.parametrize("scheme", ["radau", "gauss"])
def test_mixed_indices_and_blocks_of_units(scheme):
    """Tanks with species, each unit a block of its own that takes the time from the model."""
    m = pyo.ConcreteModel(name="plant")
    m.t = ContinuousSet(bounds=(0, 1))
    m.species = pyo.Set(initialize=["a", "b"])
    m.grade = pyo.Set(initialize=[(1, 1), (1, 2)])

    def unit(b, i):
        b.x = pyo.Var(m.species, m.t, m.grade, initialize=1)
        b.dx = DerivativeVar(b.x, wrt=m.t)
        b.ode = pyo.Constraint(m.species, m.t, m.grade, rule=decay)
        for s in m.species:
            for g in m.grade:
                b.x[(s, 0, *g)].fix(1)

    def decay(b, s, t, g, h):
        return b.dx[s, t, g, h] == -b.index() * h * b.x[s, t, g, h]

    m.unit = pyo.Block([1, 2], rule=unit)
    m.spent = Integral([1, 2], m.t, wrt=m.t, rule=lambda m, i, t: m.unit[i].x["a", t, 1, 1])
    COLLOCATION.apply_to(m, nfe=5, ncp=3, scheme=scheme)
    solved(m)
    assert m.unit[2].x["b", 1, 1, 2].value == pytest.approx(exp(-4), abs=1e-5)
    assert pyo.value(m.spent[1]) == pytest.approx(1 - exp(-1), abs=1e-7)
    trajectory = rcp.dae_trajectory(m, m.t)
    assert "unit[2].x[b,1,2]" in trajectory.states
    assert trajectory.rates["unit[2].x[b,1,2]"] == pytest.approx(trajectory.signals["unit[2].dx[b,1,2]"])


@pytest.mark.casadi
@pytest.mark.parametrize("order", [("first", "second"), ("second", "first")])
def test_sets_one_after_the_other_with_schemes_of_their_own(order):
    m = two_phases()
    schemes = {"first": ("gauss", 3), "second": ("LAGRANGE-RADAU", 5)}
    for name in order:
        scheme, stages = schemes[name]
        COLLOCATION.apply_to(m, wrt=m.component(name), nfe=6, ncp=stages, scheme=scheme)
    assert max(CASES["two sets"].errors(solved(m))) < 1e-8


@pytest.mark.casadi
@pytest.mark.parametrize("sequence", [("t", "z"), ("z", "t"), ("t z",)])
def test_heat_equation(sequence):
    """u_t = u_zz with both sets collocated, u = 0 at both ends: exp(-pi^2 t) sin(pi z)."""
    m = pyo.ConcreteModel(name="rod")
    m.t, m.z = ContinuousSet(bounds=(0, 0.1)), ContinuousSet(bounds=(0, 1))
    m.u = pyo.Var(m.t, m.z, initialize=0)
    m.ut, m.uzz = DerivativeVar(m.u, wrt=m.t), DerivativeVar(m.u, wrt=(m.z, m.z))
    m.heat = pyo.Constraint(m.t, m.z, rule=lambda m, t, z: m.ut[t, z] == m.uzz[t, z])
    m.cold = pyo.Constraint(m.t, m.z, rule=lambda m, t, z: m.u[t, z] == 0 if z in (0, 1) else pyo.Constraint.Skip)
    m.start = pyo.Constraint(
        m.t,
        m.z,
        rule=lambda m, t, z: m.u[t, z] == sin(pi * z) if t == 0 and 0 < z < 1 else pyo.Constraint.Skip,
    )
    for names in sequence:
        COLLOCATION.apply_to(m, wrt=[m.component(name) for name in names.split()], nfe=4, ncp=3)
    assert free_variables(m) == 0
    solved(m)
    error = max(abs(m.u[0.1, z].value - exp(-(pi**2) * 0.1) * sin(pi * z)) for z in m.z)
    assert error < 3e-4


def test_parameters_and_expressions_follow():
    m = tank(initialize=0)
    m.feed = pyo.Param(m.t, initialize=lambda m, t: 2 * t)
    m.rate = pyo.Param(m.t, initialize=1.5, mutable=True)
    m.level = pyo.Expression(m.t, rule=lambda m, t: m.feed[t] + m.x[t])
    COLLOCATION.apply_to(m, nfe=3)
    assert all(m.feed[t] == 2 * t and m.rate[t].value == 1.5 for t in m.t)
    assert len(m.level) == len(m.t)


# -------------------------------------------------------------------- units, timing, other tools


@pytest.mark.parametrize("scheme", ["radau", "gauss", "lobatto"])
@pytest.mark.parametrize("derivatives", ["substitute", "keep"])
def test_units_stay_consistent(scheme, derivatives):
    pytest.importorskip("pint")
    units = pyo.units
    m = pyo.ConcreteModel()
    m.t = ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.t, units=units.m, initialize=1)
    m.dx = DerivativeVar(m.x, units=units.m / units.s)
    m.ddx = DerivativeVar(m.x, wrt=(m.t, m.t), units=units.m / units.s**2)
    m.k = pyo.Param(initialize=4, units=1 / units.s**2, mutable=True)
    m.y = pyo.Var(m.t, units=units.m, initialize=1)
    m.dy = DerivativeVar(m.y, units=units.m / units.s)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.ddx[t] == -m.k * m.x[t])
    m.follow = pyo.Constraint(m.t, rule=lambda m, t: m.dy[t] == m.dx[t])
    m.way = Integral(m.t, rule=lambda m, t: m.x[t])
    m.cost = pyo.Objective(expr=m.way)
    assert_units_consistent(m)
    COLLOCATION.apply_to(m, nfe=2, scheme=scheme, derivatives=derivatives)
    assert_units_consistent(m)


def test_timing_is_reported():
    stream = StringIO()
    report_timing(stream)
    try:
        COLLOCATION.apply_to(tank(initialize=0), nfe=2)
    finally:
        report_timing(False)
    assert "Collocation" in stream.getvalue()


@pytest.mark.casadi
def test_pairs_in_blocks_of_time_and_a_relaxation_by_hand():
    m = rectifier()
    m.del_component(m.pairs)
    m.contact = pyo.Block(m.t, rule=_contact)
    COLLOCATION.apply_to(m, nfe=6)
    relax = pyo.TransformationFactory("pyrobocop.relax_complementarity")
    token = relax.apply_to(m, delta=1e-8)
    assert len(relax.shifted_rows_of(m)) == 19  # and at the first point
    pyo.SolverFactory("pyrobocop.ipopt").solve(m)
    assert CASES["complementarity"].errors(m)[0] < 1e-2
    assert rcp.dae_trajectory(m, m.t).pairs["contact.pair"].shape == (2, 18)
    relax.revert(m, token)
    COLLOCATION.apply_to(m, nfe=9)


def _contact(b, t):
    m = b.model()
    b.pair = Complementarity(expr=complements(m.p[t] >= 0, m.n[t] >= 0))


@pytest.mark.casadi
def test_state_that_refers_into_blocks_of_time():
    m = pyo.ConcreteModel(name="holdup")
    m.t = ContinuousSet(bounds=(0, 1))
    m.b = pyo.Block(m.t, rule=_holdup)
    m.held = pyo.Reference(m.b[:].amount)
    m.gain = DerivativeVar(m.held, wrt=m.t)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.gain[t] == -m.b[t].outflow)
    m.held[0].fix(1)
    COLLOCATION.apply_to(m, nfe=5, scheme="gauss")
    solved(m)
    # At the ends of elements Gauss has no stage: the outflow there follows from its own equation.
    assert m.b[0.2].outflow.value == pytest.approx(2 * m.b[0.2].amount.value)
    assert m.b[1].amount.value == pytest.approx(exp(-2), abs=1e-6)
    assert rcp.dae_trajectory(m, m.t).states["b.amount"][-1] == m.b[1].amount.value


def _holdup(b, t):
    b.amount, b.outflow = pyo.Var(initialize=1), pyo.Var(initialize=1)
    b.law = pyo.Constraint(expr=b.outflow == 2 * b.amount)


def test_tools_of_pyomo_read_the_result():
    m = tank(initialize=0)
    COLLOCATION.apply_to(m, nfe=3)
    interface = DynamicModelInterface(m, m.t)
    data = interface.get_data_at_time(m.t.last())
    assert data.get_data_from_key("x[*]") == 1
    assert m.t.get_lower_element_boundary(1.0) == pytest.approx(2 / 3)


def test_settings_within_blocks_of_time_reach_every_point():
    m = tank(initialize=0)
    m.b = pyo.Block(m.t, rule=_with_two)
    for t in m.t:
        m.b[t].w.fix(0.7)
        m.b[t].q.setub(2)
    COLLOCATION.apply_to(m, nfe=2, scheme="gauss")
    assert {(b.w.value, b.w.fixed, b.q.ub) for b in m.b.values()} == {(0.7, True, 2)}


def _with_two(b, t):
    b.w, b.q = pyo.Var(initialize=0), pyo.Var(bounds=(0, 5))
