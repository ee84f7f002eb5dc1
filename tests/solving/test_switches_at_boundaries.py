"""Where pairs switch inside elements, `solve` moves the boundaries there, or says where it is and what to write."""

from math import sqrt

import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.phases.remeshing import free_element_widths

HORIZON, TARGET = 2.0, 5 / 3


def choose_the_start(elements: int, stages: int = 3) -> pyo.ConcreteModel:
    """x' = 2 - sign(x); a fixed mesh has a local minimum in every element (Stewart & Anitescu 2010)."""
    m, b = one_phase("phase", model="start", duration=HORIZON, elements=elements, stages=stages)
    b.x = rcp.State(initial=(-2, 0), initial_guess=0)
    b.positive = rcp.mechanics.Step(b.x)
    b.ode(lambda b, t: {b.x: 3 - 2 * b.positive[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2) + (b.x[b.time.last()] - TARGET) ** 2)
    return m


def exact() -> float:
    """With the switch at s the cost is ``3 s^3 + (2 - s)^3 / 3 + (1/3 - s)^2``."""
    s = (-6 + sqrt(36 + 32 * 14 / 3)) / 16
    return 3 * s**3 + (HORIZON - s) ** 3 / 3 + (HORIZON - s - TARGET) ** 2


def least_fuel(elements: int) -> pyo.ConcreteModel:
    """A unit mass by 1 in 3 s with |u| <= 1; the jumps are those of the sides, which no pair changes."""
    m, b = one_phase("phase", model="fuel", duration=3.0, elements=elements)
    b.x, b.v = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
    b.push, b.pull = rcp.Control(bounds=(0, 1)), rcp.Control(bounds=(0, 1))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.push[t] - b.pull[t]})
    b.complementarity(lambda b, t: rcp.complements(b.push[t] >= 0, b.pull[t] >= 0))
    m.fuel = pyo.Objective(expr=b.integral(lambda b, t: b.push[t] + b.pull[t]))
    return m


@pytest.mark.ipopt
@pytest.mark.parametrize("elements", [7, 10])
def test_the_answer_is_that_of_continuous_time(elements: int) -> None:
    m = choose_the_start(elements)
    result = rcp.solve(m, progress=False)
    assert not result.doubts
    assert result.objective == pytest.approx(exact(), rel=1e-4)
    trajectory = m.phase.trajectory()
    assert trajectory.verify().natural_residual <= 1e-6
    switch = -m.phase.x[0.0].value / 3
    assert min(abs(time - switch) for time in trajectory.grid.mesh.boundaries) < 1e-6


@pytest.mark.ipopt
def test_without_a_tolerance_the_mesh_stays_and_the_number_is_the_meshs() -> None:
    m = choose_the_start(10)
    mesh = m.phase.grid.mesh
    result = rcp.solve(m, progress=False, mesh_tolerance=None)
    assert m.phase.grid.mesh == mesh
    assert abs(result.objective - exact()) > 1e-3  # or the law above would state nothing


@pytest.mark.ipopt
def test_where_the_mesh_has_to_stay_the_first_lines_say_what_switches_where() -> None:
    m = choose_the_start(10)
    inner = m.phase.points.at(2)
    m.fixed_place = pyo.Constraint(expr=m.phase.x[inner] <= 5)  # without a rule: no other mesh has this time
    mesh = m.phase.grid.mesh
    result = rcp.solve(m, progress=False)
    assert m.phase.grid.mesh == mesh
    assert m.phase.x[inner].value is not None
    assert any("change sides inside of elements" in doubt.message for doubt in result.doubts)
    assert "free_element_widths" in str(result)


@pytest.mark.ipopt
def test_controls_that_jump_at_no_switch_of_a_pair_are_met_too() -> None:
    result = rcp.solve(least_fuel(10), progress=False)
    assert result.objective == pytest.approx(3 - sqrt(5), rel=1e-3)


@settings(max_examples=15, deadline=None)
@given(st.integers(2, 6), st.integers(1, 3), st.floats(-1.0, 1.0))
def test_boundaries_that_begin_to_move_change_nothing_where_they_are(elements: int, stages: int, start: float) -> None:
    m, b = one_phase("phase", start=start, duration=HORIZON, elements=elements, stages=stages)
    b.x = rcp.State(initial=1, initial_guess=lambda t: 1 + t * t)
    b.u = rcp.Control(initial_guess=lambda t: 2 - t)
    b.ode(lambda b, t: {b.x: b.u[t] * t + b.x[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + t * b.u[t]))
    rows = list(m.component_data_objects(pyo.Constraint, active=True))
    before = [pyo.value(row.body) for row in rows], pyo.value(m.cost), list(b.time)
    free_element_widths([b], (0.5, 2.0))
    widths = {id(row) for row in b.boundary_width.values()}
    after = [row for row in m.component_data_objects(pyo.Constraint, active=True) if id(row) not in widths]
    assert [pyo.value(row.body) for row in after] == pytest.approx(before[0], rel=1e-12, abs=1e-12)
    assert pyo.value(m.cost) == pytest.approx(before[1], rel=1e-12)
    assert list(b.time) == before[2]
    # And they do move: the integral of what stays the same over a horizon is that of the horizon.
    m.area = pyo.Expression(expr=b.integral(lambda b, t: 3.0))
    b.boundary[1].set_value(0.9 * b.boundary[1].value)
    assert pyo.value(m.area) == pytest.approx(3.0 * HORIZON)
    assert pyo.value(b.time_at(b.grid.mesh.boundaries[1])) < b.grid.mesh.boundaries[1]
