"""Before a solve a mesh is made fine enough for what the statement says of the time."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.discretisation.first_meshes import mesh_from_statement


def heated(elements: int = 12, hour: float = 1.0, days: float = 6.0, shift: float = 0.0, sin: Any = pyo.sin) -> Any:
    """A house over some days; `hour` is an hour in the unit of time."""
    m = pyo.ConcreteModel(name="heated")
    m.p = b = rcp.PhaseBlock(duration=24 * days * hour, elements=elements)
    b.T, b.u = rcp.State(initial=18.0), rcp.Control(bounds=(0, 5))
    frequency = 2 * math.pi / (24 * hour)
    b.ode(lambda b, t: {b.T: (-(b.T[t] - 8 - 6 * sin(frequency * t + shift)) / 20 + b.u[t]) / hour})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (0.01 * (b.T[t] - 20) ** 2 + 0.02 * b.u[t] ** 2) / hour))
    return m


def scalar(rate: Callable[[Any, Any], Any], elements: int = 8, duration: Any = 4.0, **control: Any) -> Any:
    m = pyo.ConcreteModel(name="scalar")
    m.p = b = rcp.PhaseBlock(duration=duration, elements=elements)
    b.x, b.u = rcp.State(initial=0.0, final=1.0, history=0.5), rcp.Control(**control)
    b.ode(lambda b, t: {b.x: rate(b, t)})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


# -------------------------------------------------------------------- what stays


@pytest.mark.parametrize(
    "rate",
    [
        lambda b, t: b.u[t] - b.x[t] ** 3,
        lambda b, t: b.u[t] + pyo.sin(200 * b.x[t]),
        lambda b, t: b.u[t] + 2 * t - t**2,  # the polynomials hold it
        lambda b, t: b.u[t] if float(t) >= 0 else -b.u[t],  # has to know the time, and says the same at all times
    ],
)
def test_what_does_not_vary_between_the_points_keeps_its_mesh(rate: Callable[[Any, Any], Any]) -> None:
    m = scalar(rate)
    before, variables = m.p.grid.mesh, list(m.p.x.values())
    meshes = mesh_from_statement([m.p])
    assert meshes.remarks == meshes.unseen() == []
    assert m.p.grid.mesh is before
    assert all(one is other for one, other in zip(variables, m.p.x.values(), strict=True))


def test_phases_with_pairs_steps_or_moving_boundaries_keep_their_meshes() -> None:
    m = pyo.ConcreteModel()
    m.pairs = b = rcp.PhaseBlock(duration=1.0, elements=4, scheme="implicit_euler")
    b.x, b.force = rcp.State(initial=1.0), rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.force[t] - pyo.sin(90 * t)})
    b.complementarity(lambda b, t: rcp.complements(b.x[t] >= 0, b.force[t] >= 0))
    m.moving = b = rcp.PhaseBlock(duration=1.0, elements=4, free_element_widths=(0.5, 2))
    b.x = rcp.State(initial=1.0)
    b.ode(lambda b, t: {b.x: pyo.sin(90 * b.time_at(t))})
    m.steps = b = rcp.PhaseBlock(duration=1.0, elements=4, scheme="implicit_euler")
    b.x = rcp.State(initial=1.0)
    b.step_map(lambda b, t, previous: {b.x: previous.x + pyo.sin(90 * t)})
    mesh_from_statement([m.pairs, m.moving, m.steps])
    assert [phase.grid.mesh.elements for phase in (m.pairs, m.moving, m.steps)] == [4, 4, 4]


def test_a_control_that_is_constant_over_the_elements_keeps_them_and_what_they_miss_is_said() -> None:
    def rate(b: Any, t: Any) -> Any:
        return b.u[t] + pyo.sin(40 * t)

    m = scalar(rate, parametrization="piecewise_constant")
    assert "'u' is piecewise constant over its elements" in mesh_from_statement([m.p]).unseen()[0]
    assert m.p.grid.mesh.elements == 8
    m = scalar(rate, parametrization="piecewise_constant", knots=(0.0, 1.0, 4.0))
    assert mesh_from_statement([m.p]).unseen() == []
    assert m.p.grid.mesh.elements > 60
    assert {0.0, 1.0, 4.0} <= set(m.p.grid.mesh.boundaries)


def test_what_cannot_follow_keeps_the_mesh_and_what_it_misses_is_said() -> None:
    m = scalar(lambda b, t: b.u[t] + pyo.sin(40 * t))
    m.there = pyo.Constraint(expr=m.p.x[2.0 - 0.5 * (1 - m.p.grid.scheme.c[1])] <= 5)  # a point, and no rule
    meshes = mesh_from_statement([m.p])
    assert m.p.grid.mesh.elements == 8
    (said,) = meshes.unseen()
    assert "ode" in said
    assert "there" in said


def test_a_mesh_that_may_not_be_fine_enough_is_as_fine_as_it_may_be() -> None:
    m = heated(elements=3, days=30.0)
    meshes = mesh_from_statement([m.p])
    assert m.p.grid.mesh.elements == 24
    assert "24 elements" in meshes.unseen()[0]
    m.p.remesh(150)
    assert meshes.unseen() == []  # it is asked of the mesh that the phase has by then


# -------------------------------------------------------------------- what is seen


def errors_between(m: Any, function: Callable[[Any], Any]) -> float:
    """Mean distance of a function from the polynomials through its values at the stages."""
    grid, found = m.p.grid, []
    for start, width in zip(grid.mesh.boundaries, grid.mesh.widths, strict=False):
        at = (np.arange(50) + 0.5) / 50
        through = np.polyfit(grid.scheme.c, function(start + width * grid.scheme.c), grid.scheme.stages - 1)
        found.append(width * np.abs(np.polyval(through, at) - function(start + width * at)).mean())
    return float(np.sum(found)) / (grid.mesh.boundaries[-1] - grid.mesh.boundaries[0])


@given(shift=st.floats(0, 6.3), hour=st.sampled_from([1.0, 1 / 24, 60.0, 3600.0]), elements=st.integers(4, 24))
@settings(max_examples=15, deadline=None)
def test_days_are_seen_in_any_unit_of_time_from_any_hour_on(shift: float, hour: float, elements: int) -> None:
    m = heated(elements, hour, shift=shift)
    meshes = mesh_from_statement([m.p])
    assert meshes.unseen() == []
    assert errors_between(m, lambda t: np.sin(2 * np.pi * t / (24 * hour) + shift)) < 0.03
    assert elements <= m.p.grid.mesh.elements <= max(elements, 40)
    if m.p.grid.mesh.elements > elements:
        assert f"has {m.p.grid.mesh.elements} elements in place of {elements}" in meshes.remarks[0]


def test_the_unit_of_time_does_not_change_the_mesh() -> None:
    parts = []
    for hour in (1.0, 1 / 24, 3600.0):
        m = heated(hour=hour)
        mesh_from_statement([m.p])
        parts.append(np.array(m.p.grid.mesh.boundaries) / (24 * 6 * hour))
    assert np.allclose(parts[0], parts[1], atol=1e-9)
    assert np.allclose(parts[0], parts[2], atol=1e-9)


def test_a_rule_of_numbers_is_seen_like_the_same_rule_in_symbols() -> None:
    in_symbols, in_numbers = heated(), heated(sin=math.sin)
    for m in (in_symbols, in_numbers):
        mesh_from_statement([m.p])
        assert errors_between(m, lambda t: np.sin(2 * np.pi * t / 24)) < 0.03
    assert in_numbers.p.grid.mesh.elements == pytest.approx(in_symbols.p.grid.mesh.elements, rel=0.2)


@pytest.mark.parametrize("where", ["integral", "constraint", "bounds", "residual"])
def test_tables_in_costs_limits_bounds_and_residuals_are_seen(where: str) -> None:
    hours = np.arange(0.0, 49.0)
    prices = 0.2 + 0.1 * np.sin(hours * 2 * np.pi / 6)
    table = rcp.Table(hours, prices, name="price")
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=48.0, elements=10)
    b.x = rcp.State(initial=0.0)
    b.u = rcp.Control(bounds=(lambda t: (0.0, float(table(t)))) if where == "bounds" else (0, 1))
    b.ode(lambda b, t: {b.x: b.u[t]})
    if where == "constraint":
        b.constraint(lambda b, t: b.u[t] <= table(t))
    if where == "residual":
        b.z = rcp.Algebraic()
        b.residual(lambda b, t: b.z[t] == table(t) * b.u[t])
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] * (table(t) if where == "integral" else 1.0)))
    meshes = mesh_from_statement([m.p])
    assert errors_between(m, lambda t: 0.2 + 0.1 * np.sin(t * 2 * np.pi / 6)) < 0.005
    assert where in meshes.remarks[0]


def test_a_forcing_is_seen_where_the_duration_is_to_be_found_as_far_as_the_guess_goes() -> None:
    duration = rcp.Duration(bounds=(5, 60), initial_guess=30.0)
    m = scalar(lambda b, t: b.u[t] + pyo.sin(4 * b.time_at(t)), elements=15, duration=duration)
    mesh_from_statement([m.p])
    assert errors_between(m, lambda index: np.sin(4 * 30 * index)) < 0.03


@pytest.mark.parametrize("scheme", ["radau", "gauss", "implicit_euler", "explicit_euler", "lobatto"])
@pytest.mark.parametrize("by_number", [False, True])
def test_no_element_has_a_jump_inside(scheme: str, by_number: bool) -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=4.0, elements=8, scheme=scheme)
    b.x, b.u = rcp.State(initial=0.0), rcp.Control()
    jump = (lambda t: 1.0 if t < 1.3 else 0.2) if by_number else (lambda t: pyo.Expr_if(t < 1.3, 1.0, 0.2))
    b.ode(lambda b, t: {b.x: b.u[t] * jump(t)})
    meshes = mesh_from_statement([m.p])
    assert "jumps at 1 instant" in meshes.remarks[0]
    assert min(abs(time - 1.3) for time in m.p.grid.mesh.boundaries) < 1e-10


@pytest.mark.ipopt
@pytest.mark.parametrize("elements", [4, 6, 8, 20])
def test_a_step_that_each_element_sees_one_side_of_gives_the_exact_answer(elements: int) -> None:
    """Minimum effort with an effect that halves at 1.3: least squares, by hand."""
    m = scalar(lambda b, t: b.u[t] * pyo.Expr_if(t < 1.3, 1.0, 0.5), elements)
    result = rcp.solve(m)
    assert result.solved
    assert result.objective == pytest.approx(1 / (1.3 + 0.25 * 2.7), rel=1e-8)
    kept = rcp.solve(scalar(lambda b, t: b.u[t] * pyo.Expr_if(t < 1.3, 1.0, 0.5), elements), mesh_tolerance=None)
    assert kept.objective != pytest.approx(result.objective, rel=1e-3)


@pytest.mark.ipopt
@pytest.mark.parametrize("elements", [10, 20])
def test_a_drive_of_which_each_element_sees_the_same_part(elements: int) -> None:
    """The least effort for x' = u sin(w t) over whole periods is 2 by hand; twice a period goes into each element."""
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=1.0, elements=elements)
    b.x, b.u = rcp.State(initial=1.0, final=2.0), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t] * pyo.sin(4 * math.pi * elements * t)})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    result = rcp.solve(m)
    assert result.solved
    assert result.objective == pytest.approx(2.0, rel=1e-3)


@pytest.mark.ipopt
def test_a_pulse_between_the_points_is_not_overlooked() -> None:
    def pushed(mesh: Any) -> Any:
        m = pyo.ConcreteModel()
        m.p = b = rcp.PhaseBlock(duration=10.0, mesh=mesh)
        b.x, b.v = rcp.State(initial=0, final=0), rcp.State(initial=0, final=0)
        b.u = rcp.Control(bounds=(-10, 10))
        b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + 400 * pyo.exp(-(((t - 4.13) / 0.003) ** 2))})
        m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + 0.1 * b.u[t] ** 2))
        return m

    coarse = list(range(0, 11, 2))
    near = (4.13 + np.linspace(-0.02, 0.02, 81)).tolist()
    fine = [*np.linspace(0, 4.1, 42).tolist(), *near, *np.linspace(4.16, 10, 60).tolist()]
    exact = rcp.solve(pushed(fine), mesh_tolerance=None).objective
    assert abs(rcp.solve(pushed(coarse), mesh_tolerance=None).objective) < 1e-3 * exact  # nothing of it is seen
    result = rcp.solve(pushed(coarse))
    assert result.solved
    assert result.objective == pytest.approx(exact, rel=1e-3)


# -------------------------------------------------------------------- delays


@pytest.mark.ipopt
def test_a_delayed_control_is_read_at_points_of_the_mesh() -> None:
    def delayed(elements: int) -> Any:
        m = pyo.ConcreteModel()
        m.p = b = rcp.PhaseBlock(duration=4.0, elements=elements)
        b.x, b.u = rcp.State(initial=1.0, history=1.0), rcp.Control(history=0.5)
        b.ode(lambda b, t: {b.x: -b.x[t] + 0.8 * b.x.delayed(t, 0.7) + b.u.delayed(t, 0.7)})
        m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + 0.2 * b.u[t] ** 2))
        return m

    m = delayed(10)
    result = rcp.solve(m)
    exact = rcp.solve(delayed(280), mesh_tolerance=None)  # 49 elements for a delay
    assert result.solved
    assert result.objective == pytest.approx(exact.objective, rel=1e-4)
    boundaries = np.array(m.p.grid.mesh.boundaries)
    assert max(np.abs(boundaries - earlier).min() for earlier in boundaries[boundaries > 0.7] - 0.7) < 1e-9
