"""Other people's models at the initial point: what is fixed there, before or after, is a condition of the model."""

import logging
from itertools import product

import pyomo.environ as pyo
import pytest
from catalogue.cart_pole import cart_pole
from harness.dae import driven_tank, free_variables, solved
from pyomo.dae import ContinuousSet, DerivativeVar, Integral
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ContradictionError

OURS = pyo.TransformationFactory("pyrobocop.collocation")
FEED, FLOW, VOLUME, RATE, HORIZON = 20.0, 1.0, 1.5, 0.4, 4.0


def reactor(explicit=False):
    """A stirred tank as flowsheet programs write it: holdup, accumulation, and algebraics with bounds."""
    m = pyo.ConcreteModel(name="reactor")
    m.t = ContinuousSet(bounds=(0, HORIZON))
    m.holdup = pyo.Var(m.t, initialize=10.0)
    m.accumulation = DerivativeVar(m.holdup, wrt=m.t, initialize=0.0)
    m.feed = pyo.Var(m.t, initialize=1.0, bounds=(0, None))
    m.volume = pyo.Var(m.t, initialize=1.0, bounds=(0, None))
    m.flow = pyo.Var(m.t, initialize=1.0, bounds=(0, None))
    m.content = pyo.Var(m.t, initialize=5.0, bounds=(0, None))
    m.made = pyo.Var(m.t, initialize=-1.0)
    right = lambda m, t: FLOW * m.feed[t] - m.flow[t] * m.content[t] + m.made[t]  # noqa: E731
    if explicit:
        m.balance = pyo.Constraint(m.t, rule=lambda m, t: m.accumulation[t] == right(m, t))
    else:
        m.balance = pyo.Constraint(m.t, rule=lambda m, t: 2 * m.accumulation[t] == 2 * right(m, t))
    m.definition = pyo.Constraint(m.t, rule=lambda m, t: m.volume[t] * m.content[t] == m.holdup[t])
    m.reaction = pyo.Constraint(m.t, rule=lambda m, t: m.made[t] == -RATE * m.volume[t] * m.content[t] ** 2)
    m.hydraulics = pyo.Constraint(m.t, rule=lambda m, t: m.flow[t] == FLOW * (m.volume[t] / VOLUME) ** 0.5)
    return m


STEADY = brentq(lambda c: FLOW * FEED - FLOW * c - RATE * VOLUME * c**2, 0, FEED)


def content_at_the_end():
    """By an integrator that knows nothing of collocation."""

    def rate(t, n):
        c = n / VOLUME
        return FLOW * FEED / 2 - FLOW * c - RATE * VOLUME * c**2

    answer = solve_ivp(rate, (0, HORIZON), [VOLUME * STEADY], rtol=1e-11, atol=1e-11)
    return answer.y[0, -1] / VOLUME


def fix_inputs(m):
    for t in m.t:
        m.feed[t].fix(FEED if t == 0 else FEED / 2)
    m.volume.fix(VOLUME)


def content_at_the_start(m):
    """Of a model that its inputs make square."""
    fix_inputs(m)
    assert free_variables(m) == 0
    return solved(m).content[0].value


# Every two of these choices meet, in 12 of 48 cases.
EVERY_TWO = [
    (scheme, (i + second) % 2 == 1, (first, second))
    for (i, scheme), first, second in product(enumerate(["radau", "gauss", "lobatto"]), [False, True], [False, True])
]


@pytest.mark.heavy
@pytest.mark.casadi
@pytest.mark.parametrize(("scheme", "explicit", "fixed_before"), EVERY_TWO)
def test_a_steady_start_is_a_condition_whenever_it_is_stated(scheme, explicit, fixed_before):
    m = reactor(explicit)
    if fixed_before[0]:
        m.volume.fix(VOLUME)
    if fixed_before[1]:
        m.accumulation[0].fix(0)
    OURS.apply_to(m, wrt=m.t, nfe=16, ncp=3, scheme=scheme)
    m.accumulation[0].fix(0)
    assert content_at_the_start(m) == pytest.approx(STEADY, rel=1e-8)
    assert m.accumulation[0].value == 0
    if scheme != "lobatto":  # the feed jumps at a stage of it
        assert m.content[HORIZON].value == pytest.approx(content_at_the_end(), rel=1e-6)


@pytest.mark.casadi
def test_a_derivative_that_is_freed_again():
    m = reactor(explicit=True)
    OURS.apply_to(m, wrt=m.t, nfe=8)
    m.accumulation[0].fix(0)
    assert m.accumulation[0].fixed
    m.accumulation[0].unfix()
    assert not m.accumulation[0].fixed
    m.holdup[0].fix(3.0)
    assert content_at_the_start(m) == pytest.approx(2.0)
    assert m.accumulation[0].value == pytest.approx(FLOW * FEED - FLOW * 2 - RATE * VOLUME * 4)


@pytest.mark.casadi
@pytest.mark.parametrize("scheme", ["radau", "gauss"])
def test_a_profile_that_jumps_after_the_start_may_be_fixed_afterwards(scheme):
    """No row ties the value at the start to the next one when both are given."""
    m = driven_tank(initialize=0)
    OURS.apply_to(m, nfe=4, scheme=scheme)
    for t in m.t:
        m.u[t].fix(5 if t == 0 else 1)
    assert free_variables(m) == 0
    solved(m)
    assert all(x.value == pytest.approx(1) for x in m.x.values())
    assert m.dx[0].value == pytest.approx(4)


@pytest.mark.parametrize("scheme", ["radau", "lobatto"])
def test_what_does_not_hold_at_the_start_is_named(scheme, caplog):
    m = driven_tank(initialize=0)
    m.limit = pyo.Constraint(m.t, rule=lambda m, t: m.u[t] <= 3)
    with caplog.at_level(logging.INFO, logger="pyrobocop_pyomo"):
        OURS.apply_to(m, nfe=4, scheme=scheme)
    assert ("these do not hold there: 'limit'" in caplog.text) == (scheme == "radau")


@pytest.mark.casadi
def test_scaled_copies_know_what_is_fixed():
    m = reactor(explicit=True)
    OURS.apply_to(m, nfe=8)
    fix_inputs(m)
    m.accumulation[0].fix(0)
    m.scaling_factor = pyo.Suffix(direction=pyo.Suffix.EXPORT)
    for variable in (m.holdup, m.content):
        m.scaling_factor[variable] = 0.1
    scaling = pyo.TransformationFactory("core.scale_model")
    scaled = scaling.create_using(m, rename=False)
    assert free_variables(scaled) == 0
    scaling.propagate_solution(solved(scaled), m)
    assert m.content[0].value == pytest.approx(STEADY, rel=1e-8)


@pytest.mark.casadi
@pytest.mark.parametrize("scheme", ["radau", "gauss"])
def test_accelerations_with_a_mass_matrix_follow_from_the_force_that_is_shown(scheme):
    m = cart_pole()
    OURS.apply_to(m, nfe=10, scheme=scheme)
    for state in (m.x, m.angle, m.v, m.w):
        state[5].unfix()
    m.angle[5].fix(1)
    solved(m)
    assert m.force[0].value == pytest.approx(m.force[m.t.at(2)].value)
    assert abs(m.force[0].value) > 1e-3
    assert all(abs(pyo.value(row.body) - pyo.value(row.upper)) < 1e-9 for row in (m.cart[0], m.pole[0]))
    m.force[0].fix(2)  # nothing else knows of it
    assert solved(m).dv[0].value == pytest.approx(2.0)


def rigid_pendulum(start):
    """Of index three: the rod's force is in no equation that the states leave open."""
    m = pyo.ConcreteModel("rigid pendulum")
    m.t = ContinuousSet(bounds=(0, 1))
    m.x, m.y, m.v, m.w = (pyo.Var(m.t, initialize=start) for start in (1.0, 0.1, 0.0, 0.0))
    m.force = pyo.Var(m.t, initialize=1.0)
    m.dx, m.dy, m.dv, m.dw = (DerivativeVar(state) for state in (m.x, m.y, m.v, m.w))
    m.right = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.v[t])
    m.up = pyo.Constraint(m.t, rule=lambda m, t: m.dy[t] == m.w[t])
    m.push = pyo.Constraint(m.t, rule=lambda m, t: m.dv[t] == -m.force[t] * m.x[t])
    m.pull = pyo.Constraint(m.t, rule=lambda m, t: m.dw[t] == -m.force[t] * m.y[t] - 9.81)
    m.rod = pyo.Constraint(m.t, rule=lambda m, t: m.x[t] ** 2 + m.y[t] ** 2 == 1)
    m.x[0].fix(start), m.y[0].fix(0), m.v[0].fix(0), m.w[0].fix(0)
    return m


@pytest.mark.casadi
def test_a_model_of_index_three_has_the_answer_of_dae_collocation():
    found = []
    for way in ("dae.collocation", "pyrobocop.collocation"):
        m = rigid_pendulum(1.0)
        pyo.TransformationFactory(way).apply_to(m, nfe=8, ncp=3)
        found.append([m.x[1].value, m.y[1].value, m.force[1].value] if solved(m) else None)
    assert found[0] == pytest.approx(found[1], rel=1e-8)


@pytest.mark.casadi
def test_an_inconsistent_start_of_higher_index_is_said_by_name():
    m = rigid_pendulum(0.9)
    OURS.apply_to(m, nfe=8, ncp=3)
    with pytest.raises(ContradictionError, match=r"rod\[0"):
        rcp.solve(m, progress=False)


@pytest.mark.parametrize(
    "solver",
    [
        pytest.param("pyrobocop.ipopt", marks=pytest.mark.casadi),
        pytest.param("ipopt", marks=pytest.mark.executable),
        pytest.param("ipopt_v2", marks=pytest.mark.executable),
    ],
)
def test_a_condition_at_the_start_holds_through_every_solver_of_pyomo(solver):
    m = reactor()
    OURS.apply_to(m, wrt=m.t, nfe=10, ncp=3)
    fix_inputs(m)
    m.accumulation[0].fix(0)
    pyo.SolverFactory(solver).solve(m)
    assert m.content[0].value == pytest.approx(STEADY, rel=1e-6)
    assert m.content[HORIZON].value == pytest.approx(content_at_the_end(), rel=1e-6)


# --------------------------------------------------------------------
# Values at points without a stage: what equations determine there, what is fixed there, and what is shown.


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
@pytest.mark.parametrize("scheme", SCHEMES)
def test_every_equation_holds_at_every_point(scheme):
    m = regulator(bounds=(-0.6, 1))
    m.x[0].fix(1)
    OURS.apply_to(m, nfe=4, scheme=scheme)
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
@pytest.mark.parametrize(
    ("end", "scheme", "as_row"), [*product((0, 2), SCHEMES, [False]), (0, "radau", True), (0, "gauss", True)]
)
def test_a_given_algebraic_is_a_condition_on_the_state(end, scheme, as_row):
    m = regulator()
    m.u.fix(0.5)
    if as_row:
        m.given = pyo.Constraint(expr=m.y[end] == 4)
    else:
        m.y[end].fix(4)
    OURS.apply_to(m, nfe=3, scheme=scheme)
    solved(m)
    assert abs(m.x[end].value) == pytest.approx(2)
    assert m.x[2].value - m.x[0].value == pytest.approx(1)


@pytest.mark.casadi
@pytest.mark.parametrize("what", ["u", "dx"])
@pytest.mark.parametrize("before", [True, False])
def test_a_control_or_a_rate_that_is_fixed_decides_on_the_start_alone(before, what):
    found = []
    for fixes in (False, True):
        m = regulator()
        m.x[0].fix(1)
        for after in (False, True):
            if fixes and before is not after:
                m.component(what)[0].fix(0.7)
            if not after:
                OURS.apply_to(m, nfe=4)
        found.append(pyo.value(solved(m).cost))
    assert m.u[0].value == pytest.approx(0.7)
    assert m.dx[0].value == pytest.approx(0.7)
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
