"""Time and space, mixed indices, blocks, several sets, references, disjuncts, tools of Pyomo."""

from math import exp

import pyomo.environ as pyo
import pytest
from catalogue.dae_models import CASES, rectifier, two_phases
from catalogue.pyomo_examples import heat, steady_exchanger
from harness.checked import timing_report
from harness.dae import driven_tank, free_variables, solved
from hypothesis import given, settings
from hypothesis import strategies as st
from pyomo.contrib.mpc import DynamicModelInterface
from pyomo.dae import ContinuousSet, DerivativeVar, Integral
from pyomo.mpec import Complementarity, complements
from pyomo.util.check_units import assert_units_consistent

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import shifted_rows_of
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics import Matching

OURS = pyo.TransformationFactory("pyrobocop.collocation")


def discretise(m, *steps):
    """Apply transformations in order: (name of the set, scheme, elements)."""
    for name, scheme, elements in steps:
        domain = m.component(name)
        if scheme in ("BACKWARD", "FORWARD", "CENTRAL"):
            pyo.TransformationFactory("dae.finite_difference").apply_to(m, wrt=domain, nfe=elements, scheme=scheme)
        elif scheme == "dae":
            pyo.TransformationFactory("dae.collocation").apply_to(m, wrt=domain, nfe=elements, ncp=3)
        else:
            OURS.apply_to(m, wrt=domain, nfe=elements, ncp=3, scheme=scheme)
    return m


def values(variable):
    """In the order of the indices, which pyomo.dae rounds to six digits."""
    return [variable[index].value for index in sorted(variable)]


# -------------------------------------------------------------------- one set by pyomo.dae


@pytest.mark.casadi
@pytest.mark.parametrize("space", ["BACKWARD", "dae"])
def test_pyomo_dae_in_space_before_or_after(space):
    """In time our rows are those of dae.collocation, so that all values agree, at the corners as well."""
    elements = {"BACKWARD": 5, "dae": 2}[space]
    theirs = solved(discretise(heat(), ("x", space, elements), ("t", "dae", 3)))
    for steps in (
        [("x", space, elements), ("t", "radau", 3)],
        [("t", "radau", 3), ("x", space, elements)],
    ):
        ours = discretise(heat(), *steps)
        assert values(solved(ours).u) == pytest.approx(values(theirs.u), abs=1e-6)


@pytest.mark.casadi
@pytest.mark.parametrize("time", ["BACKWARD", "dae"])
def test_heat_equation_without_equations_at_the_boundaries(time):
    found = []
    for steps in ([("x", "gauss", 3), ("t", time, 3)], [("t", time, 3), ("x", "gauss", 3)]):
        found.append(values(solved(discretise(heat(), *steps)).u))
    assert found[0] == pytest.approx(found[1], abs=1e-6)


def test_two_sets_of_one_variable_by_this_package_are_refused():
    with pytest.raises(ModelError, match="'u': is indexed by 'x' and 't'. Discretise one of them here"):
        OURS.apply_to(heat(), nfe=2)
    m = discretise(heat(), ("x", "gauss", 2))
    with pytest.raises(ModelError, match="is indexed by 'x' and 't'"):
        OURS.apply_to(m, wrt=m.t)
    assert list(m.t) == [0, 1]


def test_a_refusal_leaves_no_trace():
    m = discretise(heat(), ("t", "BACKWARD", 2))
    n = discretise(heat(), ("x", "gauss", 3), ("t", "BACKWARD", 2))
    with pytest.raises(ModelError, match=r"'dudx2\[1,.*has no equation, .* gauss has none at either end"):
        OURS.apply_to(m, wrt=m.x, nfe=3, ncp=3)
    OURS.apply_to(m, wrt=m.x, nfe=3, ncp=3, scheme="gauss")
    assert list(m.x) == list(n.x)
    rows = [one.component_data_objects(pyo.Constraint, active=True) for one in (m, n)]
    names = [{(row.parent_component().name, row.index()) for row in of} for of in rows]
    assert names[0] == names[1]


# -------------------------------------------------------------------- opposite directions


@pytest.mark.casadi
def test_steady_exchanger():
    """Both streams are linear, and their difference is the same everywhere."""
    m = steady_exchanger()
    OURS.apply_to(m, nfe=10, scheme="gauss")
    assert free_variables(m) == 0
    solved(m)
    # up' = down' = -c/2 and up - down = c, so 1 - c = down(0) = c / 2.
    c = 2 / 3
    assert max(abs(m.up[z].value - (1 - c * z / 2)) for z in m.z) < 1e-9
    assert max(abs(m.down[z].value - (c / 2 - c * z / 2)) for z in m.z) < 1e-9
    assert rcp.dae_trajectory(m, m.z).states["down"][0] == pytest.approx(c / 2, abs=1e-9)


# -------------------------------------------------------------------- matchings


@given(st.lists(st.lists(st.integers(0, 5), min_size=1, max_size=3, unique=True), max_size=8))
@settings(max_examples=50, deadline=None)
def test_a_matching_prefers_the_rows_before(incidence):
    """As many rows as any matching; and each prefix of the rows is matched as well as it can be alone."""
    left = Matching(incidence, range(6)).unmatched_rows
    for count in range(len(incidence) + 1):
        assert [row for row in left if row < count] == Matching(incidence[:count], range(6)).unmatched_rows


# --------------------------------------------------------------------
# Mixed indices, blocks, several sets, references, disjuncts, tools of Pyomo.


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
    OURS.apply_to(m, nfe=5, ncp=3, scheme=scheme)
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
        OURS.apply_to(m, wrt=m.component(name), nfe=6, ncp=stages, scheme=scheme)
    assert max(CASES["two sets"].errors(solved(m))) < 1e-8


def test_parameters_and_expressions_follow():
    m = driven_tank(initialize=0)
    m.feed = pyo.Param(m.t, initialize=lambda m, t: 2 * t)
    m.rate = pyo.Param(m.t, initialize=1.5, mutable=True)
    m.level = pyo.Expression(m.t, rule=lambda m, t: m.feed[t] + m.x[t])
    OURS.apply_to(m, nfe=3)
    assert all(m.feed[t] == 2 * t and m.rate[t].value == 1.5 for t in m.t)
    assert len(m.level) == len(m.t)


# -------------------------------------------------------------------- units, timing, other tools


@pytest.mark.parametrize("scheme", ["radau", "gauss", "lobatto"])
def test_units_stay_consistent(scheme):
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
    OURS.apply_to(m, nfe=2, scheme=scheme)
    assert_units_consistent(m)


def test_timing_is_reported():
    assert "Collocation" in timing_report(lambda: OURS.apply_to(driven_tank(initialize=0), nfe=2))


@pytest.mark.casadi
def test_pairs_in_blocks_of_time_and_a_relaxation_by_hand():
    m = rectifier()
    m.del_component(m.pairs)
    m.contact = pyo.Block(m.t, rule=_contact)
    OURS.apply_to(m, nfe=6)
    relax = pyo.TransformationFactory("pyrobocop.relax_complementarity")
    token = relax.apply_to(m, delta=1e-8)
    assert len(shifted_rows_of(m)) == 19  # and at the first point
    pyo.SolverFactory("pyrobocop.ipopt").solve(m)
    assert CASES["complementarity"].errors(m)[0] < 1e-2
    assert rcp.dae_trajectory(m, m.t).pairs["contact.pair"].shape == (2, 18)
    relax.revert(m, token)


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
    OURS.apply_to(m, nfe=5, scheme="gauss")
    solved(m)
    # At the ends of elements Gauss has no stage: the outflow there follows from its own equation.
    assert m.b[0.2].outflow.value == pytest.approx(2 * m.b[0.2].amount.value)
    assert m.b[1].amount.value == pytest.approx(exp(-2), abs=1e-6)
    assert rcp.dae_trajectory(m, m.t).states["b.amount"][-1] == m.b[1].amount.value


def _holdup(b, t):
    b.amount, b.outflow = pyo.Var(initialize=1), pyo.Var(initialize=1)
    b.law = pyo.Constraint(expr=b.outflow == 2 * b.amount)


def test_tools_of_pyomo_read_the_result():
    m = driven_tank(initialize=0)
    OURS.apply_to(m, nfe=3)
    interface = DynamicModelInterface(m, m.t)
    data = interface.get_data_at_time(m.t.last())
    assert data.get_data_from_key("x[*]") == 1
    assert m.t.get_lower_element_boundary(1.0) == pytest.approx(2 / 3)


def test_settings_within_blocks_of_time_reach_every_point():
    m = driven_tank(initialize=0)
    m.b = pyo.Block(m.t, rule=_with_two)
    for t in m.t:
        m.b[t].w.fix(0.7)
        m.b[t].q.setub(2)
    OURS.apply_to(m, nfe=2, scheme="gauss")
    assert {(b.w.value, b.w.fixed, b.q.ub) for b in m.b.values()} == {(0.7, True, 2)}


def _with_two(b, t):
    b.w, b.q = pyo.Var(initialize=0), pyo.Var(bounds=(0, 5))
