"""The laws of a discretisation, through `PhaseBlock` itself: its order, and what is the same however it is stated."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.convergence import observed_order
from harness.phases import (
    EXACT_COSTS,
    HORIZON,
    each_collocated,
    exact_x,
    exact_y,
    integrator,
    one_phase,
    oscillate,
    oscillators,
    running_costs,
    solve,
)

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi


SCHEMES = [
    *(scheme(stages) for stages in range(1, 6) for scheme in (rcp.schemes.radau, rcp.schemes.gauss_legendre)),
    *(rcp.schemes.lobatto(stages) for stages in range(2, 6)),
    rcp.schemes.find_scheme("explicit_euler"),
    rcp.schemes.Scheme.from_points("left", [0, 2 / 3]),
]
# Fine enough for the leading term of the error, coarse enough for three meshes above rounding.
MESHES = {
    1: (80, 120, 160, 240),
    2: (16, 24, 32, 48),
    3: (24, 32, 48, 64),
    4: (8, 12, 16, 24),
    5: (8, 12, 16, 24),
    6: (4, 6, 8, 12),
    7: (4, 5, 6, 8, 10),
    8: (3, 4, 5, 6, 8),
    9: (2, 3, 4, 5, 6, 7),
    10: (2, 3, 4, 5, 6),
}


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_end_state_and_running_cost_converge_with_the_computed_order(scheme: rcp.schemes.Scheme) -> None:
    state_errors, cost_errors = [], []
    for elements in MESHES[scheme.order]:
        m = oscillators(elements=elements, scheme=scheme)
        m.nothing = pyo.Objective(expr=0)
        solve(m)
        end = m.swing.final_time
        # Norms over two equations: the coefficient of one error alone may happen to vanish.
        state_errors.append(math.hypot(m.swing.x[end].value - exact_x(end), m.swing.y[end].value - exact_y(end)))
        costs = [pyo.value(cost) for cost in running_costs(m.swing)]
        cost_errors.append(math.hypot(*np.subtract(costs, EXACT_COSTS)))
    # Two-sided: too good is a bug as well.
    assert observed_order(MESHES[scheme.order], state_errors, 1e-13) == pytest.approx(scheme.order, abs=0.2)
    assert observed_order(MESHES[scheme.order], cost_errors, 1e-13) == pytest.approx(scheme.order, abs=0.2)


INDEX_ONE = [
    *(scheme(stages) for stages in range(1, 4) for scheme in (rcp.schemes.radau, rcp.schemes.gauss_legendre)),
    *(rcp.schemes.lobatto(stages) for stages in range(2, 5)),
    rcp.schemes.find_scheme("explicit_euler"),
]


@pytest.mark.parametrize("form", ["ode", "residual"])
@pytest.mark.parametrize("scheme", INDEX_ONE, ids=str)
def test_a_differential_algebraic_equation_of_index_one_converges_with_the_computed_order(
    scheme: rcp.schemes.Scheme, form: str
) -> None:
    """``x' - z = 0`` and ``z exp(-x) = cos(t)``: then exp(-x) = 1 - sin(t) and z = cos(t) / (1 - sin(t)).

    The algebraic has the order of the stages: one more than their number for collocation, as far as the scheme goes.
    """
    meshes = MESHES[scheme.order] if scheme.order < 6 else (6, 9, 12, 16)
    errors, algebraic_errors = [], []
    for elements in meshes:
        m, b = one_phase("dae", duration=0.5, elements=elements, scheme=scheme, x=rcp.State(initial=0))
        b.z = rcp.Algebraic(initial_guess=1)
        if form == "ode":
            b.ode(lambda b, t: {b.x: b.z[t]})

        @b.residual
        def equations(b, t):
            algebraic = b.z[t] * pyo.exp(-b.x[t]) == pyo.cos(t)
            return algebraic if form == "ode" else [b.derivative(b.x)[t] - b.z[t], algebraic]

        m.dae.check()
        m.nothing = pyo.Objective(expr=0)
        solve(m)
        errors.append(abs(b.x[0.5].value + math.log(1 - math.sin(0.5))))
        algebraic_errors.append(max(abs(b.z[t].value - math.cos(t) / (1 - math.sin(t))) for t in b.points))
    assert observed_order(meshes, errors, 1e-13) == pytest.approx(scheme.order, abs=0.2)
    stage_order = min(scheme.order, scheme.stages + 1)
    assert observed_order(meshes, algebraic_errors, 1e-12) == pytest.approx(stage_order, abs=0.3)


CONTROL_ORDER = {"radau": 0, "gauss": 1, "lobatto": -1, "explicit_euler": 0, "left": 0}


@pytest.mark.parametrize("scheme", [s for s in SCHEMES if s.stages <= 3 and s.b.min() > 1e-14], ids=str)
def test_optimal_control_and_optimal_cost_converge(scheme: rcp.schemes.Scheme) -> None:
    """min of the integral of x^2 + u^2, x' = u, x(0) = 1: u = -sinh(T - t) / cosh(T), and the cost is tanh(T).

    The cost has the order of the scheme. A collocated control has the number of stages, one more for Gauss, one less
    for Lobatto.
    """
    meshes = (16, 24, 32, 48) if scheme.order <= 3 else (6, 8, 12, 16)
    control_errors, cost_errors = [], []
    for elements in meshes:
        m, b = integrator(x={"initial": 1}, elements=elements, scheme=scheme)
        m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
        solve(m)
        control_errors.append(max(abs(b.u[t].value + math.sinh(1 - t) / math.cosh(1)) for t in b.points))
        cost_errors.append(abs(pyo.value(m.cost) - math.tanh(1)))
    expected = scheme.stages + CONTROL_ORDER[scheme.name.partition("(")[0]]
    assert observed_order(meshes, control_errors, 1e-12) == pytest.approx(expected, abs=0.3)
    if cost_errors[2] > 1e-13:
        assert observed_order(meshes, cost_errors, 1e-13) == pytest.approx(scheme.order, abs=0.2)


def test_an_unevenly_given_mesh_is_integrated_as_well_as_its_widths_allow() -> None:
    m = oscillators(mesh=[0, 0.1, 0.5, 0.6, 1.1, HORIZON], scheme="gauss", stages=4)
    m.nothing = pyo.Objective(expr=0)
    solve(m)
    assert m.swing.x[HORIZON].value == pytest.approx(exact_x(HORIZON), rel=1e-7)
    assert m.swing.x[0.6].value == pytest.approx(exact_x(0.6), rel=1e-7)


# --------------------------------------------------------------------
# Two ways to state the same thing give the same numbers.


def values(phase: Any, *names: str) -> list[float]:
    return [v for name in names for v in getattr(phase.trajectory(), name).tolist()]


def solved(m: pyo.ConcreteModel) -> pyo.ConcreteModel:
    if not any(True for _ in m.component_objects(pyo.Objective)):
        m.nothing = pyo.Objective(expr=0)
    solve(m)
    return m


@each_collocated
def test_a_kept_derivative_and_the_residual_form_change_nothing_but_the_number_of_variables(
    scheme: rcp.schemes.Scheme,
) -> None:
    substituted = solved(oscillators(elements=4, scheme=scheme))
    kept, _ = one_phase("swing", duration=HORIZON, elements=4, scheme=scheme)
    kept.swing.x = rcp.State(initial=1, initial_guess=1, derivative_bounds=(-50, 50))
    kept.swing.y = rcp.State(initial=1, initial_guess=1, derivative_bounds=(None, None))
    kept.swing.ode(oscillate)
    solved(kept)
    assert values(kept.swing, "x", "y") == pytest.approx(values(substituted.swing, "x", "y"), abs=1e-12)
    assert len(kept.swing.x_derivative) == len(kept.swing.x_equation) == 4 * scheme.stages
    for t in kept.swing.points:
        rate = pyo.value(substituted.swing.derivative("y")[t])
        assert kept.swing.derivative(kept.swing.y)[t].value == pytest.approx(rate, abs=1e-10)

    implicit, b = one_phase("swing", duration=HORIZON, elements=4, scheme=scheme)
    b.x, b.y = rcp.State(initial=1, initial_guess=1), rcp.State(initial=1, initial_guess=1)

    @b.residual
    def oscillators_once_more(b, t):
        rates = oscillate(b, t)
        return {name: b.derivative(state)[t] == rates[state] for name, state in (("of_x", b.x), ("of_y", b.y))}

    b.check()
    solved(implicit)
    assert values(b, "x", "y") == pytest.approx(values(substituted.swing, "x", "y"), abs=1e-12)


@each_collocated
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
    m, b = one_phase("cart", duration=2, elements=7, scheme=scheme, position=rcp.State(initial=0, final=1))
    b.velocity = rcp.State(initial=0, final=0, bounds=(-5, 0.7))
    # Bounds that change in time: both must take them at the point where the row asks the control.
    b.force = rcp.Control(bounds=lambda t: (-1.2 - t, 3 - t), parametrization=parametrization)
    b.ode(lambda b, t: {b.position: b.velocity[t], b.velocity: b.force[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.force[t] ** 2))
    return m


@pytest.mark.parametrize("scheme", ["implicit_euler", "implicit_midpoint"])
def test_a_held_control_on_one_stage_is_the_collocated_one(scheme: str) -> None:
    constant, collocated = (double_integrator(each, scheme) for each in ("piecewise_constant", "collocated"))
    for m in (constant, collocated):
        solve(m, 1e-10)
    names = ("position", "velocity", "force")
    assert values(constant.cart, *names) == pytest.approx(values(collocated.cart, *names), abs=1e-6)


@each_collocated
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


def test_a_constraint_at_boundaries_holds_where_gauss_has_no_stages() -> None:
    """Throw a ball over a wall: without the constraint at the boundaries it may dip under between the stages."""
    heights = {}
    for at_boundaries in (False, True):
        m, b = integrator(x={"initial": 0, "final": 0}, elements=3, scheme="gauss", stages=1)
        b.constraint(lambda b, t: b.x[t] <= 0.2, name="ceiling")
        if at_boundaries:
            b.constraint_at_boundaries(lambda b, t: b.x[t] <= 0.25, name="low")

            assert list(b.low) == list(b.grid.mesh.boundaries)
        m.high = pyo.Objective(expr=b.x[b.grid.mesh.boundaries[1]], sense=pyo.maximize)
        assert rcp.solve(m).solved
        heights[at_boundaries] = max(b.x[t].value for t in b.grid.mesh.boundaries)
        for t in b.grid.mesh.boundaries[1:-1]:
            b.x[t].set_value(b.x[t].value + 0.1)
        assert (b.trajectory().verify().equations > 0.09) is at_boundaries
    assert heights[False] == pytest.approx(0.4, abs=1e-6)  # the stage in the middle of the first element is at 0.2
    assert heights[True] == pytest.approx(0.25, abs=1e-6)
