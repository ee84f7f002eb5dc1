"""The laws of a discretisation, through `PhaseBlock` itself: the measured order is the computed one."""

from __future__ import annotations

import math

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.convergence import observed_order
from harness.phases import EXACT_COSTS, HORIZON, exact_x, exact_y, oscillators, running_costs, solve

import pyrobocop_pyomo as rcp

SCHEMES = [scheme(stages) for stages in range(1, 6) for scheme in (rcp.radau, rcp.gauss_legendre)]
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
def test_end_state_and_running_cost_converge_with_the_computed_order(scheme: rcp.CollocationScheme) -> None:
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


@pytest.mark.parametrize(
    "scheme", [rcp.radau(1), rcp.radau(2), rcp.radau(3), rcp.gauss_legendre(1), rcp.gauss_legendre(2)], ids=str
)
def test_a_differential_algebraic_equation_of_index_one_converges_with_the_computed_order(
    scheme: rcp.CollocationScheme,
) -> None:
    """``x' - z = 0`` and ``z exp(-x) = cos(t)``, both implicit: then exp(-x) = 1 - sin(t)."""
    errors = []
    for elements in MESHES[scheme.order]:
        m = pyo.ConcreteModel()
        m.dae = rcp.PhaseBlock(duration=0.5, elements=elements, scheme=scheme)
        m.dae.x = rcp.State(initial=0)
        m.dae.z = rcp.Algebraic(guess=1)

        @m.dae.residual
        def equations(b, t):
            return [b.derivative(b.x)[t] - b.z[t], b.z[t] * pyo.exp(-b.x[t]) == pyo.cos(t)]

        m.dae.check()
        m.nothing = pyo.Objective(expr=0)
        solve(m)
        errors.append(abs(m.dae.x[0.5].value + math.log(1 - math.sin(0.5))))
    assert observed_order(MESHES[scheme.order], errors, 1e-13) == pytest.approx(scheme.order, abs=0.2)


def test_an_unevenly_given_mesh_is_integrated_as_well_as_its_widths_allow() -> None:
    m = oscillators(mesh=[0, 0.1, 0.5, 0.6, 1.1, HORIZON], scheme="gauss", stages=4)
    m.nothing = pyo.Objective(expr=0)
    solve(m)
    assert m.swing.x[HORIZON].value == pytest.approx(exact_x(HORIZON), rel=1e-7)
    assert m.swing.x[0.6].value == pytest.approx(exact_x(0.6), rel=1e-7)
