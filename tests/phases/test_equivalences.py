"""Two ways to state the same thing give the same numbers."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import HORIZON, integrator, oscillate, oscillators, running_costs, solve

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError

pytestmark = pytest.mark.casadi

SOME_SCHEMES = [
    rcp.schemes.radau(1),
    rcp.schemes.radau(3),
    rcp.schemes.gauss_legendre(1),
    rcp.schemes.gauss_legendre(3),
]
each_scheme = pytest.mark.parametrize("scheme", SOME_SCHEMES, ids=str)


def values(phase: Any, *names: str) -> list[float]:
    return [v for name in names for v in getattr(phase.trajectory(), name).tolist()]


def solved(m: pyo.ConcreteModel) -> pyo.ConcreteModel:
    if not any(True for _ in m.component_objects(pyo.Objective)):
        m.nothing = pyo.Objective(expr=0)
    solve(m)
    return m


@each_scheme
def test_a_kept_derivative_changes_nothing_but_the_number_of_variables(scheme: rcp.schemes.Scheme) -> None:
    substituted = solved(oscillators(elements=4, scheme=scheme))
    kept = pyo.ConcreteModel()
    kept.swing = rcp.PhaseBlock(duration=HORIZON, elements=4, scheme=scheme)
    kept.swing.x = rcp.State(initial=1, initial_guess=1, derivative_bounds=(-50, 50))
    kept.swing.y = rcp.State(initial=1, initial_guess=1, derivative_bounds=(None, None))
    kept.swing.ode(oscillate)
    solved(kept)
    assert values(kept.swing, "x", "y") == pytest.approx(values(substituted.swing, "x", "y"), abs=1e-12)
    assert len(kept.swing.x_derivative) == len(kept.swing.x_equation) == 4 * scheme.stages
    for t in kept.swing.points:
        rate = pyo.value(substituted.swing.derivative("y")[t])
        assert kept.swing.derivative(kept.swing.y)[t].value == pytest.approx(rate, abs=1e-10)


@each_scheme
def test_the_residual_form_is_the_ode_form(scheme: rcp.schemes.Scheme) -> None:
    explicit = solved(oscillators(elements=4, scheme=scheme))
    implicit = pyo.ConcreteModel()
    implicit.swing = b = rcp.PhaseBlock(duration=HORIZON, elements=4, scheme=scheme)
    b.x, b.y = rcp.State(initial=1, initial_guess=1), rcp.State(initial=1, initial_guess=1)

    @b.residual
    def oscillators_once_more(b, t):
        rates = oscillate(b, t)
        return {name: b.derivative(state)[t] == rates[state] for name, state in (("of_x", b.x), ("of_y", b.y))}

    b.check()
    solved(implicit)
    assert values(b, "x", "y") == pytest.approx(values(explicit.swing, "x", "y"), abs=1e-12)


@each_scheme
def test_a_free_duration_held_at_its_value_is_the_fixed_duration(scheme: rcp.schemes.Scheme) -> None:
    fixed = solved(oscillators(elements=4, scheme=scheme, start=0.25))
    free = oscillators(elements=4, scheme=scheme, start=0.25, duration=rcp.Duration(bounds=(0.1, 9)))
    free.swing.duration.fix(HORIZON)
    solved(free)
    assert values(free.swing, "x", "y") == pytest.approx(values(fixed.swing, "x", "y"), abs=1e-11)
    assert free.swing.trajectory().time == pytest.approx(fixed.swing.trajectory().time, abs=1e-14)
    for a, b in zip(running_costs(free.swing), running_costs(fixed.swing), strict=True):
        assert pyo.value(a) == pytest.approx(pyo.value(b), abs=1e-11)


def double_integrator(parametrization: str, scheme: Any) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.cart = b = rcp.PhaseBlock(duration=2, elements=7, scheme=scheme)
    b.position = rcp.State(initial=0, final=1)
    b.velocity = rcp.State(initial=0, final=0, bounds=(-5, 0.7))
    # Bounds that change in time: both must take them at the point where the row asks the control.
    b.force = rcp.Control(bounds=lambda t: (-1.2 - t, 3 - t), parametrization=parametrization)
    b.ode(newton)
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.force[t] ** 2))
    return m


def newton(b: Any, t: float) -> dict[Any, Any]:
    return {b.position: b.velocity[t], b.velocity: b.force[t]}


@pytest.mark.parametrize("scheme", ["implicit_euler", "implicit_midpoint"])
def test_a_held_control_on_one_stage_is_the_collocated_one(scheme: str) -> None:
    constant, collocated = (double_integrator(each, scheme) for each in ("piecewise_constant", "collocated"))
    for t in collocated.cart.points:
        assert constant.cart.force[t].bounds == collocated.cart.force[t].bounds
    for m in (constant, collocated):
        solve(m, 1e-10)
    names = ("position", "velocity", "force")
    assert values(constant.cart, *names) == pytest.approx(values(collocated.cart, *names), abs=1e-6)


@each_scheme
@pytest.mark.parametrize("duration", [HORIZON, rcp.Duration(bounds=(1.1, 1.3))])
def test_an_integral_is_the_gain_of_an_additional_state(scheme: rcp.schemes.Scheme, duration: Any) -> None:
    m = oscillators(elements=3, scheme=scheme, duration=duration)
    m.swing.gain = rcp.State(initial=0)
    m.swing.ode(lambda b, t: {b.gain: b.x[t] * b.y[t] - b.time_at(t)})
    cost = m.swing.integral(lambda b, t: b.x[t] * b.y[t] - b.time_at(t))
    if m.swing.has_free_duration:
        m.swing.duration.fix(1.2)
    solved(m)
    assert m.swing.gain[m.swing.final_time].value == pytest.approx(pyo.value(cost), abs=1e-12)


def ceiling(b, t):
    return b.x[t] <= 0.2


@pytest.mark.casadi
def test_a_constraint_at_boundaries_holds_where_gauss_has_no_stages() -> None:
    """Throw a ball over a wall: without the constraint at the boundaries it may dip under between the stages."""
    heights = {}
    for at_boundaries in (False, True):
        m, b = integrator(x={"initial": 0, "final": 0}, elements=3, scheme="gauss", stages=1)
        b.constraint(ceiling)
        if at_boundaries:

            @b.constraint_at_boundaries
            def low(b, t):
                return b.x[t] <= 0.25

            assert list(b.low) == list(b.grid.mesh.boundaries)
        m.high = pyo.Objective(expr=b.x[b.grid.mesh.boundaries[1]], sense=pyo.maximize)
        assert rcp.solve(m).solved
        heights[at_boundaries] = max(b.x[t].value for t in b.grid.mesh.boundaries)
        for t in b.grid.mesh.boundaries[1:-1]:
            b.x[t].set_value(b.x[t].value + 0.1)
        assert (b.trajectory().verify().equations > 0.09) is at_boundaries
    assert heights[False] == pytest.approx(0.4, abs=1e-6)  # the stage in the middle of the first element is at 0.2
    assert heights[True] == pytest.approx(0.25, abs=1e-6)


def test_a_constraint_at_boundaries_reads_states_only() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=1, elements=3)
    b.x = rcp.State(initial=0)
    b.u = rcp.Control()
    before = list(b.component_map())
    with pytest.raises(ModelError, match="'gentle' reads what has no value at an element boundary .*'constraint'"):

        @b.constraint_at_boundaries
        def gentle(b, t):
            return b.u[t] <= 1

    assert list(b.component_map()) == before


def test_a_tuple_of_three_numbers_and_expressions_is_one_row_with_two_bounds() -> None:
    """Pyomo's own form; relations in a list or tuple are rows of their own."""
    counts = {}
    for name, rule in {
        "ranged": lambda b, t: (-1, b.x[t], 0.9),
        "relations": lambda b, t: (b.x[t] >= -1, b.x[t] <= 0.9),
        "inequality": lambda b, t: pyo.inequality(-1, b.x[t], 0.9),
    }.items():
        _, b = integrator(x={"initial": 0}, stages=1)
        b.constraint(rule, name=name)
        rows = list(b.component(name).values())
        counts[name] = len(rows)
        assert min(row.ub for row in rows if row.ub is not None) == 0.9
        b.x.set_values(dict.fromkeys(b.x, 2.0))
        b.u.set_values(dict.fromkeys(b.u, 0.0))
        assert b.trajectory().verify().equations == pytest.approx(1.1)
    assert counts == {"ranged": 2, "relations": 4, "inequality": 2}
