"""Before a solve a mesh gets boundaries at what is stated of single times; all else is seen by its errors."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.phases import mass, one_phase

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.discretisation.first_meshes import mesh_from_statement


def scalar(rate: Callable[[Any, Any], Any], elements: int = 8, duration: Any = 4.0, **control: Any) -> Any:
    m, b = one_phase(model="scalar", duration=duration, elements=elements)
    b.x, b.u = rcp.State(initial=0.0, final=1.0, history=0.5), rcp.Control(**control)
    b.ode(lambda b, t: {b.x: rate(b, t)})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


@pytest.mark.parametrize(
    "rate",
    [
        lambda b, t: b.u[t] - b.x[t] ** 3,
        lambda b, t: b.u[t] + pyo.sin(200 * t),
        lambda b, t: b.u[t] if float(t) >= 0 else -b.u[t],  # has to know the time, and says the same at all times
        lambda b, t: pyo.Expr_if(b.x[t] < t, b.u[t], 2 * b.u[t]),
    ],
)
def test_what_does_not_jump_with_the_time_keeps_its_mesh(rate: Callable[[Any, Any], Any]) -> None:
    m = scalar(rate)
    before, variables = m.p.grid.mesh, list(m.p.x.values())
    assert mesh_from_statement([m.p]) == []
    assert m.p.grid.mesh is before
    assert all(one is other for one, other in zip(variables, m.p.x.values(), strict=True))


def test_phases_with_pairs_steps_or_boundaries_of_the_users_keep_their_meshes() -> None:
    def push(t: Any) -> Any:
        return pyo.Expr_if(t < 0.3, 1.0, 0.0)

    m = pyo.ConcreteModel()
    m.pairs = b = rcp.PhaseBlock(duration=1.0, elements=4, scheme="implicit_euler")
    b.x, b.force = rcp.State(initial=1.0), rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.force[t] - push(t)})
    b.complementarity(lambda b, t: rcp.complements(b.x[t] >= 0, b.force[t] >= 0))
    m.moving = b = rcp.PhaseBlock(duration=1.0, elements=4, free_element_widths=(0.5, 2))
    b.x = rcp.State(initial=1.0)
    b.ode(lambda b, t: {b.x: push(b.time_at(t))})
    m.steps = b = rcp.PhaseBlock(duration=1.0, elements=4, scheme="implicit_euler")
    b.x = rcp.State(initial=1.0)
    b.step_map(lambda b, t, previous: {b.x: previous.x + push(t)})
    held = scalar(lambda b, t: b.u[t] + push(t), 4, parametrization="piecewise_constant")
    assert mesh_from_statement([m.pairs, m.moving, m.steps]) == mesh_from_statement([held.p]) == []
    assert [phase.grid.mesh.elements for phase in (m.pairs, m.moving, m.steps, held.p)] == [4, 4, 4, 4]


@pytest.mark.parametrize("scheme", ["radau", "gauss", "implicit_euler", "explicit_euler", "lobatto"])
def test_no_element_has_a_jump_inside(scheme: str) -> None:
    m, b = one_phase(duration=4.0, elements=8, scheme=scheme, x=rcp.State(initial=0.0), u=rcp.Control())
    b.ode(lambda b, t: {b.x: b.u[t] * pyo.Expr_if(t < 1.3, 1.0, 0.2)})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: pyo.Expr_if(abs(b.time_at(t) - 2.2) <= 0.02, 1.0, b.u[t] ** 2)))
    (remark,) = mesh_from_statement([m.p])
    assert "11 elements in place of 8" in remark
    for jump in (1.3, 2.18, 2.22):
        assert min(abs(time - jump) for time in m.p.grid.mesh.boundaries) < 1e-10


def test_a_jump_is_seen_where_the_duration_is_to_be_found_as_far_as_the_guess_goes() -> None:
    duration = rcp.Duration(bounds=(5, 60), initial_guess=30.0)
    m = scalar(lambda b, t: b.u[t] * pyo.Expr_if(b.time_at(t) < 7.0, 1.0, 0.5), elements=15, duration=duration)
    mesh_from_statement([m.p])
    assert min(abs(index - 7.0 / 30.0) for index in m.p.grid.mesh.boundaries) < 1e-10


@pytest.mark.ipopt
@pytest.mark.parametrize("elements", [4, 20])
def test_a_step_that_each_element_sees_one_side_of_gives_the_exact_answer(elements: int) -> None:
    """Minimum effort with an effect that halves at 1.3: least squares, by hand."""
    m = scalar(lambda b, t: b.u[t] * pyo.Expr_if(t < 1.3, 1.0, 0.5), elements)
    result = solution(m)
    assert result.objective == pytest.approx(1 / (1.3 + 0.25 * 2.7), rel=1e-8)
    kept = rcp.solve(scalar(lambda b, t: b.u[t] * pyo.Expr_if(t < 1.3, 1.0, 0.5), elements), mesh_tolerance=None)
    assert kept.objective != pytest.approx(result.objective, rel=1e-3)


@pytest.mark.ipopt
@pytest.mark.parametrize("elements", [10, 20])
def test_a_drive_of_which_each_element_sees_the_same_part(elements: int) -> None:
    """The least effort for x' = u sin(w t) over whole periods is 2 by hand; twice a period goes into each element."""
    m, b = one_phase(duration=1.0, elements=elements, x=rcp.State(initial=1.0, final=2.0), u=rcp.Control())
    b.ode(lambda b, t: {b.x: b.u[t] * pyo.sin(4 * math.pi * elements * t)})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    result = solution(m)
    assert result.objective == pytest.approx(2.0, rel=1e-3)


@pytest.mark.ipopt
def test_a_pulse_between_the_points_is_not_overlooked() -> None:
    def pushed(mesh: Any) -> Any:
        m, b = one_phase(duration=10.0, mesh=mesh, x=rcp.State(initial=0, final=0), v=rcp.State(initial=0, final=0))
        b.u = rcp.Control(bounds=(-10, 10))
        b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + 40 * pyo.exp(-(((t - 4.13) / 0.03) ** 2))})
        m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + 0.1 * b.u[t] ** 2))
        return m

    coarse = list(range(0, 11, 2))
    near = (4.13 + np.linspace(-0.2, 0.2, 81)).tolist()
    fine = [*np.linspace(0, 3.9, 40).tolist(), *near, *np.linspace(4.4, 10, 60).tolist()]
    exact = rcp.solve(pushed(fine), mesh_tolerance=None).objective
    assert abs(rcp.solve(pushed(coarse), mesh_tolerance=None).objective) < 1e-3 * exact  # nothing of it is seen
    result = solution(pushed(coarse))
    assert result.objective == pytest.approx(exact, rel=1e-3)


# -------------------------------------------------------------------- times that statements name


def passing(how: str, mesh: Any = None, **control: Any) -> Any:
    """From rest to rest with the least effort, through 1 at 0.77 or near it: a cubic on both sides of that time."""
    rest, elements = {"initial": 0, "final": 0}, 5 if mesh is None else None
    m, b = mass(x=rest, v=rest, u=control, duration=2.0, mesh=mesh, elements=elements)
    cost = b.integral(lambda b, t: b.u[t] ** 2)
    if how == "row":
        m.through = pyo.Constraint(expr=b.x.at(0.77) == 1)
    elif how == "in a rule":
        b.constraint(lambda b, t: b.x.at(0.77) >= 1)
    m.cost = pyo.Objective(expr=cost + (1000 * (b.x.at(0.77) - 1) ** 2 if how == "cost" else 0.0))
    return m


@pytest.mark.ipopt
@pytest.mark.parametrize("how", ["row", "in a rule", "cost"])
def test_a_time_that_a_statement_names_is_a_boundary_or_the_error_is_not_known(how: str) -> None:
    exact = rcp.solve(passing(how, [0, 0.77, 2]), mesh_tolerance=None).objective
    m, kept = passing(how), passing(how)
    result, held = rcp.solve(m), rcp.solve(passing(how, parametrization="piecewise_constant"))
    assert 0.77 in m.p.grid.mesh.boundaries
    assert result.objective == pytest.approx(exact, rel=1e-6)
    assert rcp.solve(passing(how), mesh_tolerance=1e-6).objective == pytest.approx(exact, rel=1e-6)
    coarse = rcp.solve(kept, mesh_tolerance=None)
    assert abs(coarse.objective - exact) > 1e-4 * exact
    for found in (coarse.discretisation, held.discretisation):
        assert found.objective_error is None
        assert "t = 0.77, inside of elements" in found.remarks[0]


# -------------------------------------------------------------------- delays


@pytest.mark.ipopt
def test_a_delayed_control_is_read_at_points_of_the_mesh() -> None:
    def delayed(elements: int) -> Any:
        m, b = one_phase(duration=4.0, elements=elements)
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
