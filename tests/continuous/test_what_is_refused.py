"""What cannot be discretised is refused by name, with a remedy, and the model is as it was."""

import logging
from itertools import pairwise

import pyomo.environ as pyo
import pytest
from catalogue.dae_models import estimation
from harness.dae import picture, tank
from pyomo.dae import ContinuousSet, DerivativeVar

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, PyRobocopError, TrajectoryError

COLLOCATION = pyo.TransformationFactory("pyrobocop.collocation")


# -------------------------------------------------------------------- points without values


def add_initial_control(m):
    m.begin = pyo.Constraint(expr=m.u[0] == 0)


def add_initial_rate(m):
    m.cost = pyo.Objective(expr=m.dx[0] ** 2)


def add_jump(m):
    m.ramp = pyo.Constraint(m.t, rule=lambda m, t: m.u[t] - m.u[0] <= 1)


@pytest.mark.parametrize(
    ("add", "name"), [(add_initial_control, "begin"), (add_initial_rate, "cost"), (add_jump, r"ramp\[\d")]
)
def test_what_needs_a_value_where_there_is_none(add, name):
    m = tank()
    add(m)
    before = picture(m)
    match = rf"'{name}.*': holds '(u|dx)\[0\]', but radau\(3\) has no collocation point at t = 0: only states"
    with pytest.raises(ModelError, match=match):
        COLLOCATION.apply_to(m, nfe=4)
    assert picture(m) == before


def add_final_penalty(m):
    m.cost = pyo.Objective(expr=(m.x[2] - 3) ** 2 + m.u[2] ** 2)


def test_final_control_with_gauss():
    m = tank()
    add_final_penalty(m)
    with pytest.raises(ModelError, match=r"'cost': holds 'u\[2\]', but gauss\(3\) has no .* radau has one"):
        COLLOCATION.apply_to(m, nfe=4, scheme="gauss")
    COLLOCATION.apply_to(m, nfe=4, scheme="lobatto")


def test_fixed_rate_that_no_row_holds():
    m = tank()
    m.del_component(m.ode)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: pyo.Constraint.Skip if t == 0 else m.dx[t] == m.u[t])
    m.dx[0].fix(0)
    with pytest.raises(ModelError, match=r"'dx\[0\]': is fixed, but no equation that holds at that point has"):
        COLLOCATION.apply_to(m, nfe=4)


def test_equation_over_a_list_of_points():
    m = tank()
    m.del_component(m.ode)
    m.ode = pyo.Constraint([t for t in m.t if t > 0], rule=lambda m, t: m.dx[t] == m.u[t])
    with pytest.raises(ModelError, match=r"has no equation, .* Index the constraint by 't' itself"):
        COLLOCATION.apply_to(m, nfe=4)


# -------------------------------------------------------------------- ambiguous settings


def test_bounds_that_differ():
    m = tank()
    m.u[0].setub(1)
    m.u[2].setub(3)
    before = picture(m)
    with pytest.raises(ModelError, match=r"'u\[0\]' and 'u\[2\]': their upper bounds were set to 1 and 3;"):
        COLLOCATION.apply_to(m, nfe=4)
    assert picture(m) == before


def test_bounds_where_there_is_no_value():
    m = tank()
    m.u[0].setub(1)
    with pytest.raises(ModelError, match=r"'u\[0\]': has upper bounds of its own, but no value"):
        COLLOCATION.apply_to(m, nfe=4)
    COLLOCATION.apply_to(m, nfe=4, scheme="lobatto")


def test_abstract_model():
    m = pyo.AbstractModel()
    m.t = ContinuousSet(bounds=(0, 1))
    with pytest.raises(ModelError, match="is not constructed. Create its instance first"):
        COLLOCATION.apply_to(m)


def test_fixed_at_different_values():
    m = tank()
    m.u[0].fix(1)
    m.u[2].fix(3)
    with pytest.raises(ModelError, match=r"'u\[0\]' at 1, 'u\[2\]' at 3: fixed at different values"):
        COLLOCATION.apply_to(m, nfe=4)


# -------------------------------------------------------------------- components and sets


def test_constraint_without_rule():
    m = tank()
    m.del_component(m.drain)
    m.drain = pyo.Constraint(m.t, rule={t: m.z[t] == 0 for t in m.t})
    with pytest.raises(ModelError, match="'drain': is indexed by 't' but has no function as its rule"):
        COLLOCATION.apply_to(m)


def test_component_that_cannot_grow():
    m = tank()
    m.choice = pyo.BooleanVar(m.t)
    with pytest.raises(ModelError, match="'choice': a BooleanVar indexed by 't' cannot be discretised"):
        COLLOCATION.apply_to(m)


def test_rule_that_fails_at_a_new_point(caplog):
    caplog.set_level(logging.CRITICAL)
    m = tank()
    m.feed = pyo.Param(m.t, initialize={0: 1.0, 2: 3.0})
    m.inflow = pyo.Constraint(m.t, rule=lambda m, t: m.u[t] >= m.feed[t])
    before = picture(m)
    with pytest.raises(ModelError, match=r"'inflow': its rule failed at the new point .*ValueError: .*feed"):
        COLLOCATION.apply_to(m)
    assert picture(m) == before


@pytest.mark.parametrize("before", ["ours", "dae.finite_difference"])
def test_a_derivative_along_two_sets(before):
    m = pyo.ConcreteModel()
    m.t, m.z = ContinuousSet(bounds=(0, 1)), ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.t, m.z)
    m.dtz = DerivativeVar(m.x, wrt=(m.t, m.z))
    if before != "ours":
        pyo.TransformationFactory(before).apply_to(m, wrt=m.z, nfe=2)
    held = {c.name: len(c) for c in m.component_objects((pyo.Var, DerivativeVar))}
    with pytest.raises(ModelError, match="'dtz': is a derivative along t and z together"):
        COLLOCATION.apply_to(m, wrt=m.t, nfe=2)
    assert list(m.t) == [0, 1]
    assert {c.name: len(c) for c in m.component_objects((pyo.Var, DerivativeVar))} == held


def test_set_twice_in_one_index():
    m = tank()
    m.covariance = pyo.Var(m.t, m.t)
    with pytest.raises(ModelError, match="'covariance': is indexed by 't' twice"):
        COLLOCATION.apply_to(m)


def test_block_whose_set_lives_elsewhere():
    m = tank()
    m.b = pyo.Block()
    m.b.y = pyo.Var(m.t)
    match = "'b': the set 't' does not live in it but in 'tank'"
    with pytest.raises(ModelError, match=match):
        COLLOCATION.apply_to(m.b)
    with pytest.raises(ModelError, match=match):
        COLLOCATION.apply_to(m.b, wrt=m.t)
    m.c = pyo.Block()
    with pytest.raises(ModelError, match="'c': holds no ContinuousSet"):
        COLLOCATION.apply_to(m.c)


def test_set_in_a_block_that_others_are_indexed_by():
    m = pyo.ConcreteModel(name="plant")
    m.unit = pyo.Block()
    m.unit.t = ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.unit.t)
    with pytest.raises(ModelError, match="'x': is indexed by 'unit.t' but is no part of 'unit'"):
        COLLOCATION.apply_to(m.unit)


def test_wrong_options():
    m = tank()
    with pytest.raises(ModelError, match="wrt: 'x' is no ContinuousSet"):
        COLLOCATION.apply_to(m, wrt=m.x)
    with pytest.raises(ModelError, match="unknown scheme 'radua'"):
        COLLOCATION.apply_to(m, scheme="radua")
    with pytest.raises(ValueError, match="nfe"):
        COLLOCATION.apply_to(m, nfe=0)
    with pytest.raises(ValueError, match="neither the name of a scheme"):
        COLLOCATION.apply_to(m, scheme=3)
    with pytest.raises(ModelError, match="nfe = 3, but the mesh has 2 elements"):
        COLLOCATION.apply_to(m, nfe=3, mesh=[0, 1, 2])
    with pytest.raises(ModelError, match="'t': the mesh ends at 1, but the set ends at 2"):
        COLLOCATION.apply_to(m, mesh=[0, 1])
    m = tank((0, 0.3, 2))
    with pytest.raises(ModelError, match=r"'t': the boundaries 0.3 and 0.30000000000000004 are closer"):
        COLLOCATION.apply_to(m, mesh=[0, 0.1 * 3, 2])


def test_set_that_pyomo_dae_has_discretised():
    m = tank()
    pyo.TransformationFactory("dae.collocation").apply_to(m, nfe=2)
    with pytest.raises(ModelError, match=r"'t': was discretised by pyomo.dae \(LAGRANGE-RADAU\) already"):
        COLLOCATION.apply_to(m)


def test_what_was_built_on_a_mesh_that_goes_away():
    m = tank()
    COLLOCATION.apply_to(m, nfe=4)
    m.cost = pyo.Objective(expr=sum(m.x[t] ** 2 for t in m.t))
    before = picture(m)
    with pytest.raises(ModelError, match="'cost': was built on the mesh that 't' has now. Delete it"):
        COLLOCATION.apply_to(m, nfe=8)
    assert picture(m) == before


def test_second_of_two_sets_fails():
    m = tank()
    m.s = ContinuousSet(bounds=(0, 1))
    m.y = pyo.Var(m.s)
    m.total = pyo.Objective(expr=sum(m.y[s] for s in m.s))
    before = picture(m)
    with pytest.raises(ModelError, match="'total': is a sum over the points that 's' had"):
        COLLOCATION.apply_to(m)
    assert picture(m) == before
    m.del_component(m.total)
    COLLOCATION.apply_to(m)
    assert len(m.s) == len(m.t) == 31


def test_trajectory_of_what_is_not_there():
    m = tank()
    with pytest.raises(TrajectoryError, match="'t' was not discretised by pyrobocop.collocation"):
        rcp.dae_trajectory(m, m.t)
    COLLOCATION.apply_to(m, nfe=2)
    with pytest.raises(TrajectoryError, match=r"'z\[.*\]' has no value"):
        rcp.dae_trajectory(m, m.t)
    assert issubclass(TrajectoryError, PyRobocopError)


# --------------------------------------------------------------------
# Sums over a set are refused, boundary values and sums over chosen points are not.


def add_sum(m):
    m.cost = pyo.Objective(expr=sum(m.x[t] ** 2 for t in m.t))


def add_sum_in_an_expression(m):
    m.mean = pyo.Expression(expr=sum(m.x[t] for t in m.t) / 2)


def add_sum_of_expressions(m):
    m.square = pyo.Expression(m.t, rule=lambda m, t: m.x[t] ** 2)
    m.cost = pyo.Objective(expr=sum(m.square[t] for t in m.t))


def add_trapezoids(m):
    times = list(m.t)
    pairs = pairwise(times)
    m.cost = pyo.Objective(expr=sum(0.5 * (b - a) * (m.x[a] ** 2 + m.x[b] ** 2) for a, b in pairs))


def add_running_sum(m):
    m.used = pyo.Constraint(m.t, rule=lambda m, t: sum(m.x[s] for s in m.t if s <= t) <= 10)


@pytest.mark.parametrize(
    "add", [add_sum, add_sum_in_an_expression, add_sum_of_expressions, add_trapezoids, add_running_sum]
)
def test_sums_over_the_set(add):
    m = tank()
    add(m)
    before = picture(m)
    with pytest.raises(ModelError, match=r"is a sum over the points that 't' had .* write an Integral"):
        COLLOCATION.apply_to(m, wrt=m.t, nfe=4)
    assert picture(m) == before


def add_gain(m):
    m.cost = pyo.Objective(expr=m.x[2] - m.x[0])


def add_period(m):
    m.period = pyo.Constraint(expr=m.x[0] == m.x[2])


def add_initial_conditions(m):
    m.start = pyo.ConstraintList(rule=lambda m: iter([m.x[0] >= 0, m.x[2] >= 0]))


@pytest.mark.parametrize("add", [add_gain, add_period, add_final_penalty, add_initial_conditions])
def test_boundary_values_are_no_sums(add):
    m = tank()
    add(m)
    COLLOCATION.apply_to(m, nfe=4)


def test_measurements_by_rule_are_taken_and_without_rule_refused():
    m = estimation()
    COLLOCATION.apply_to(m, nfe=7)
    m = estimation()
    m.del_component(m.misfit)
    m.misfit = pyo.Objective(expr=sum((m.x[t] - m.data[t]) ** 2 for t in m.measured))
    with pytest.raises(ModelError, match=r"'misfit': is a sum over the points .* give it a function, rule="):
        COLLOCATION.apply_to(m, nfe=7)
    m.del_component(m.misfit)
    m.misfit = pyo.Objective(expr=sum((m.x[t] - m.data[t]) ** 2 for t in (0.9, 1.7)))
    COLLOCATION.apply_to(m, nfe=7)
