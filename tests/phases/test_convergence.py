"""The laws of a discretisation, through `PhaseBlock` itself: the measured order is the computed one."""

from __future__ import annotations

import math

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.convergence import observed_order
from harness.phases import EXACT_COSTS, HORIZON, exact_x, exact_y, integrator, oscillators, running_costs, solve

import pyrobocop_pyomo as rcp

SCHEMES = [
    *(scheme(stages) for stages in range(1, 6) for scheme in (rcp.schemes.radau, rcp.schemes.gauss_legendre)),
    *(rcp.schemes.lobatto(stages) for stages in range(2, 6)),
    *(rcp.schemes.explicit(stages) for stages in range(1, 4)),
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

pytestmark = pytest.mark.casadi


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
    rcp.schemes.explicit(1),
    rcp.schemes.explicit(2),
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
        m = pyo.ConcreteModel()
        m.dae = b = rcp.PhaseBlock(duration=0.5, elements=elements, scheme=scheme)
        b.x = rcp.State(initial=0)
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
    stage_order = scheme.stages + 1 if scheme.is_collocation else 2
    assert observed_order(meshes, algebraic_errors, 1e-12) == pytest.approx(min(scheme.order, stage_order), abs=0.3)


CONTROL_ORDER = {"radau": 0, "gauss": 1, "lobatto": -1, "explicit": 0}


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
