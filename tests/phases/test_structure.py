"""A built phase has the variables and rows that the formulas say, and leaves nothing undetermined."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import free_variables, oscillators, rank, rows, undetermined

import pyrobocop_pyomo as rcp


def plant(scheme: rcp.schemes.Scheme, parametrization: str = "collocated", **options: Any) -> pyo.ConcreteModel:
    """Two states, an algebraic, a control, a parameter."""
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(**{"duration": 2, "elements": 6, "scheme": scheme, **options})
    b.x = rcp.State(initial=0)
    b.v = rcp.State(initial=0)
    b.f = rcp.Algebraic()
    b.u = rcp.Control(bounds=(-1, 1), parametrization=parametrization)
    b.k = rcp.Parameter(bounds=(1, 2), initial_guess=1.5)
    b.ode(motion)
    b.residual(spring)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + b.x[t]))
    return m


def motion(b: Any, t: float) -> dict[Any, Any]:
    return {b.x: b.v[t], b.v: b.f[t]}


def spring(b: Any, t: float) -> Any:
    return b.f[t] == b.u[t] - b.k * b.x[t]


SCHEMES = [
    rcp.schemes.radau(1),
    rcp.schemes.radau(2),
    rcp.schemes.radau(4),
    rcp.schemes.gauss_legendre(1),
    rcp.schemes.gauss_legendre(3),
]
each_scheme = pytest.mark.parametrize("scheme", SCHEMES, ids=str)
each_control = pytest.mark.parametrize("parametrization", ["collocated", "piecewise_constant"])


@each_scheme
@each_control
def test_counts_follow_the_formulas(scheme: rcp.schemes.Scheme, parametrization: str) -> None:
    m, n, s = plant(scheme, parametrization), 6, scheme.stages
    ends = 0 if scheme.stiffly_accurate else n
    per_state = 1 + n * s + ends
    controls = n if parametrization == "piecewise_constant" else n * s
    assert len(list(m.component_data_objects(pyo.Var))) == 2 * per_state + n * s + controls + 1
    assert len(rows(m)) == 2 * (n * s + ends) + n * s
    assert len(free_variables(m)) - len(rows(m)) == controls + 1
    assert list(m.p.time) == list(m.p.grid.times)
    assert list(m.p.points) == list(m.p.u.keys()) == list(m.p.f.keys())


@each_scheme
@each_control
def test_every_variable_is_determined(scheme: rcp.schemes.Scheme, parametrization: str) -> None:
    m = plant(scheme, parametrization, duration=rcp.Duration(bounds=(1, 2)))
    m.p.check()
    assert undetermined(m) == []
    assert rank(m) == len(rows(m))


@each_scheme
def test_a_simulation_is_square_and_of_full_rank(scheme: rcp.schemes.Scheme) -> None:
    m = oscillators(scheme=scheme, elements=4)
    assert len(free_variables(m)) == len(rows(m)) == rank(m)


def test_a_held_control_is_one_variable_seen_at_each_point_of_its_element() -> None:
    b = plant(rcp.schemes.radau(3), "piecewise_constant").p
    for t, element in b.grid.element_of.items():
        assert b.u[t] is b.u_per_element[element]


def test_bounds_in_time_hold_where_the_variable_is_asked() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=2, elements=2, stages=2)
    b.u = rcp.Control(bounds=lambda t: (t, 9 - t))
    b.held = rcp.Control(bounds=lambda t: (t, 9 - t), parametrization="piecewise_constant")
    assert [b.u[t].bounds for t in b.points] == [(t, 9 - t) for t in b.points]
    assert [variable.bounds for variable in b.held_per_element.values()] == [(1, 8), (2, 7)]


def test_boundary_values_fix_bound_or_leave_free() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(elements=2)
    b.fixed = rcp.State(initial=1, final=2, bounds=(0, 5), initial_guess=4)
    b.bound = rcp.State(initial=(-1, 3), final=(None, 4), bounds=(0, 5), initial_guess=4.5)
    b.free = rcp.State(bounds=(0, 5), initial_guess=9)
    first, last = b.initial_time, b.final_time
    assert [(b.fixed[t].fixed, b.fixed[t].value) for t in (first, last)] == [(True, 1), (True, 2)]
    assert (b.bound[first].bounds, b.bound[last].bounds) == ((0, 3), (0, 4))
    assert (b.bound[first].value, b.bound[last].value) == (3, 4)
    assert all(variable.value == 5 and not variable.fixed for variable in b.free.values())


def test_a_duration_starts_within_its_bounds() -> None:
    m = pyo.ConcreteModel()
    m.a = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 4)))
    m.b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 4), initial_guess=9))
    m.c = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, None)))
    assert [phase.duration.value for phase in (m.a, m.b, m.c)] == [2, 4, 1]


def test_a_mesh_end_that_differs_by_rounding_is_the_horizon() -> None:
    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock(start=0.1, duration=0.2, mesh=[0.1, 0.2, 0.3])  # 0.1 + 0.2 is 0.30000000000000004
    assert m.p.final_time == 0.3


def test_generated_names_are_not_mistaken_for_the_users() -> None:
    """A constraint of the user's counts as an equation, whatever the end of its name."""
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(elements=2)
    b.x, b.f = rcp.State(initial=0), rcp.Algebraic()
    b.ode(lambda b, t: {b.x: b.f[t]})
    with pytest.raises(rcp.errors.PyRobocopError, match="too few equations"):
        b.check()
    b.force_equation = pyo.Constraint(b.points, rule=lambda b, t: b.f[t] == 1 - b.x[t])
    b.check()
