"""Where constraints cannot be met, what stands against it is named, and the violation falls when that gives way."""

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import integrator, one_phase
from harness.scenes import keep_clear, on_the_line
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.diagnosis.least_violation import Least, LeastViolation, least_violation
from pyrobocop_pyomo.modeling.deadline import Deadline


def least_of(m) -> LeastViolation:
    found = least_violation(m)
    assert found is not None
    return found


def cart(force: float = 2.0, duration: float = 0.5, drag: float = 0.0) -> pyo.ConcreteModel:
    m, b = one_phase(model="cart", duration=duration, elements=5)
    b.x, b.v = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
    b.u = rcp.Control(bounds=(-force, force))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - drag * b.v[t] ** 2})
    b.initialize_straight_lines()
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def random_rows(a: np.ndarray, right: list[int]) -> pyo.ConcreteModel:
    """Rows in three bounded variables, of which the last is fixed."""
    m = pyo.ConcreteModel(name="rows")
    m.x = pyo.Var(range(3), bounds=(-1, 1), initialize=0.0)
    m.x[2].fix(0.5)
    m.rows = pyo.ConstraintList()
    for row, side in zip(a.tolist(), right, strict=True):
        m.rows.add(sum(c * m.x[j] for j, c in enumerate(row)) <= side)
    return m


coefficients = st.tuples(st.integers(1, 5), st.integers(-5, 5), st.integers(-5, 5), st.sampled_from([-1, 1]))


@given(st.lists(coefficients, min_size=4, max_size=4), st.lists(st.integers(-5, 5), min_size=4, max_size=4))
def test_linear_rows_contradict_each_other_where_no_values_meet_them_and_a_relief_is_just_enough(rows, right):
    a = np.array([(sign * first, second, third) for first, second, third, sign in rows], dtype=float)
    known = linprog(np.zeros(2), a[:, :2], np.array(right) - 0.5 * a[:, 2], bounds=[(-1, 1)] * 2)
    m = random_rows(a, right)
    found = least_of(m)
    assert found.kind is {0: Least.NONE, 2: Least.PROVEN}[known.status]
    assert [m.x[j].value for j in range(3)] == [0.0, 0.0, 0.5]
    relief = found.relief
    assert (relief is None) == (found.kind is not Least.PROVEN)
    if relief is None or not found.obstructions[0].name.startswith("x"):
        return
    widened = {"x": [0, 1], "x[0]": [0], "x[1]": [1]}[found.obstructions[0].name]

    def is_met(by: float) -> bool:
        bounds = [(-1 - by, 1 + by) if j in widened else (-1, 1) for j in range(2)]
        return linprog(np.zeros(2), a[:, :2], np.array(right) - 0.5 * a[:, 2], bounds=bounds).status == 0

    if np.isfinite(relief):
        assert is_met(relief * 1.001)
        assert not is_met(relief * 0.999)
    else:
        assert not is_met(1e6)


@pytest.mark.casadi
def test_how_far_a_motion_has_to_give_way_is_what_mechanics_says():
    """From rest to rest over a distance of 1 in 0.5 s: a force of 16; at 2 it is 14 too small."""
    least = least_of(cart(force=2.0, duration=0.5))
    relief = least.relief
    assert relief is not None
    assert least.obstructions[0].name == "p.u"
    assert relief == pytest.approx(14.0, rel=0.1)  # on five elements
    wider = cart(force=2.0 + 1.001 * relief, duration=0.5)
    assert rcp.solve(wider, progress=False).solved
    assert not rcp.solve(cart(force=2.0 + 0.99 * relief, duration=0.5), progress=False).solved


@pytest.mark.casadi
def test_two_contradictions_need_more_than_one_to_give_way():
    m = pyo.ConcreteModel(name="both")
    m.x, m.y = pyo.Var(bounds=(0, 1), initialize=0), pyo.Var(bounds=(0, 1), initialize=0)
    m.far_x, m.far_y = pyo.Constraint(expr=m.x >= 3), pyo.Constraint(expr=m.y >= 2)
    m.cost = pyo.Objective(expr=m.x + m.y)
    result = rcp.solve(m, progress=False)
    assert "which is not enough alone" in str(result)
    assert result.least_violation.relief == np.inf


def test_what_stands_against_a_motion_are_the_bounds_of_its_control_and_its_ends():
    found = least_of(cart())
    assert found.kind is Least.PROVEN
    assert found.is_proof
    words = list(map(str, found.obstructions))
    assert words[0].startswith("'p.u' ")
    assert {"'p.x' fixed at 0 at t = 0", "'p.x' fixed at 1 at t = 0.5"} <= set(words)
    assert any(one.startswith("'p.u' <= 2 at ") for one in words)
    assert any(one.startswith("'p.u' >= -2 at ") for one in words)


@pytest.mark.parametrize("drag", [0.0, 0.3])
def test_the_influence_of_a_holder_is_the_slope_of_the_least_violation(drag):
    step = 1e-4
    m = cart(drag=drag)
    before = least_of(m)
    influence = {str(one): one.influence for one in before.obstructions}
    (upper,) = (name for name in influence if name.startswith("'p.u' <= 2"))
    size = 4.0  # of a control: the width of its bounds
    for control in m.p.u.values():
        control.setub(2.0 + step)
    after = least_of(m)
    assert (before.total - after.total) / step == pytest.approx(influence[upper] / size, rel=0.02)
    for control in m.p.u.values():
        control.setub(2.0)
    m.p.x[m.p.time.last()].fix(1.0 - step)
    moved = least_of(m)
    assert (before.total - moved.total) / step == pytest.approx(influence["'p.x' fixed at 1 at t = 0.5"], rel=0.02)


def test_a_local_minimum_of_the_violation_is_told_from_a_run_that_ended_early():
    m = pyo.ConcreteModel(name="square")
    m.x = pyo.Var(initialize=0.7)
    m.c = pyo.Constraint(expr=m.x**2 == -1)
    found = least_of(m)
    assert found.kind is Least.LOCAL
    assert not found.is_proof
    assert [one.name for one in found.obstructions] == ["c"]
    assert m.x.value == 0.7
    m.c.set_value(m.x**2 == 9)
    assert least_of(m).kind is Least.NONE


def test_with_pairs_it_is_meant_with_the_same_sides_at_zero():
    m, b = one_phase(model="lift", duration=1.0, elements=6, scheme="implicit_euler")
    b.height = rcp.State(initial=0, final=0.5, bounds=(0, None))
    b.speed = rcp.State(initial=0)
    b.push, b.thrust = rcp.Algebraic(bounds=(0, None)), rcp.Control(bounds=(0, 9))
    b.ode(lambda b, t: {b.height: b.speed[t], b.speed: b.thrust[t] + b.push[t] - 9.81})
    b.complementarity(lambda b, t: rcp.complements(b.height[t] >= 0, b.push[t] >= 0), name="floor")
    for t, height in b.height.items():
        height.set_value(0.5 * t, skip_validation=True)
    for variable in (*b.speed.values(), *b.push.values(), *b.thrust.values()):
        variable.set_value(0.0, skip_validation=True)
    found = least_of(m)
    words = list(map(str, found.obstructions))
    assert not found.is_proof
    assert words[0].startswith("'p.thrust' <= 9 at ")
    assert any(one.startswith("pairs of 'p.floor' at ") for one in words)
    assert "With the same sides of its pairs at zero" in str(found)


@pytest.mark.casadi
def test_a_box_that_cannot_be_toppled_names_the_bound_of_the_force():
    """Weight 49 N, 0.2 by 0.4 m: to hold it at tan(angle) = 0.2 takes 49 (0.1 - 0.2 * 0.2) / 0.4 = 7.35 N."""
    m = pyo.ConcreteModel(name="box")
    m.angle, m.force = pyo.Var(initialize=0.0, bounds=(0, 1.5)), pyo.Var(initialize=0.0, bounds=(-1, 1))
    m.support = pyo.Var(initialize=24.5, bounds=(0, None))
    lever = 0.1 * pyo.cos(m.angle) - 0.2 * pyo.sin(m.angle)
    m.moments = pyo.Constraint(expr=(0.4 * m.force + 0.2 * m.support) * pyo.cos(m.angle) == 49 * lever)
    m.floor = rcp.Complementarity(expr=rcp.complements(pyo.sin(m.angle) >= 0, m.support >= 0))
    m.goal = pyo.Constraint(expr=pyo.tan(m.angle) == 0.2)
    m.cost = pyo.Objective(expr=m.force**2)
    result = rcp.solve(m, progress=False)
    assert "widen the bound 'force' <= 1 by about" in str(result)
    m.force.setub(1 + 1.01 * result.least_violation.relief)
    assert rcp.solve(m, progress=False).objective == pytest.approx(7.35**2, rel=1e-4)


def test_clearances_are_named_by_their_shapes():
    m, b = integrator(x={"initial": 0, "final": 4}, scheme="implicit_euler")
    box, wall = rcp.Polytope.box(0.4, 0.4), rcp.Polytope.box(1, 4, center=(2, 0))
    keep_clear(b, box, {"wall": wall}, on_the_line, 0.1)
    b.initialize_straight_lines()
    b.avoid.initialize()
    words = list(map(str, least_of(m).obstructions))
    assert any(one.startswith("the clearance between 'body' and 'wall' of 'p.avoid'") for one in words)


def test_rows_without_value_and_time_that_is_up_give_nothing():
    m = pyo.ConcreteModel(name="none")
    m.x = pyo.Var(initialize=-1.0)
    m.c = pyo.Constraint(expr=pyo.log(m.x) >= 3)
    assert least_violation(m) is None
    assert least_violation(cart(), Deadline.after(0.0)) is None


@pytest.mark.parametrize("linear", [True, False])
def test_rows_that_nothing_can_move_stand_against_nothing(linear):
    m = pyo.ConcreteModel(name="circles")
    m.x, m.z = pyo.Var(initialize=1.0), pyo.Var(initialize=2.0)
    m.z.fix()
    m.held = pyo.Constraint(expr=2 * m.z == 4 if linear else m.z**2 == 4)
    m.inner, m.outer = pyo.Constraint(expr=m.x**2 == 4), pyo.Constraint(expr=m.x**2 == 9)
    names = {obstruction.name for obstruction in least_of(m).obstructions}
    assert names == {"inner", "outer"}
