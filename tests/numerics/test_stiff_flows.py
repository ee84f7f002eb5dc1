"""Stiff equations over many elements at once: the motion of SciPy's implicit methods, by elements and as a whole."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo
import pytest
from scipy.integrate import solve_ivp

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.flows import integrate_elements, integrate_flows
from pyrobocop_pyomo.numerics.stiff_flows import march_implicitly

WIDTH, ELEMENTS = 20.0, 4


def robertson(y: Array) -> Array:
    slow, fast, square = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] ** 2
    return np.array([-slow + fast, slow - fast - square, square])


def test_the_reactions_of_robertson_agree_with_scipy() -> None:
    edges = [np.array([1.0, 0.0, 0.0])]
    for _ in range(ELEMENTS):
        motion = solve_ivp(lambda t, y: robertson(y), (0, WIDTH), edges[-1], method="Radau", rtol=1e-11, atol=1e-14)
        edges.append(motion.y[:, -1])
    starts, ends, scales = np.array(edges[:-1]), np.array(edges[1:]), np.array([1.0, 1e-4, 1.0])

    def rates(_: float, states: Array) -> Array:
        with np.errstate(all="ignore"):
            return WIDTH * robertson(states)

    found = integrate_flows(rates, starts, scales, np.linspace(0.0, 1.0, 9), 1e-8)
    assert found is not None
    assert found.error <= 1e-6
    assert np.abs((found.local[:, -1] - ends) / scales).max() < 1e-7
    assert found.whole is not None
    assert np.abs((found.whole[:, -1] - ends) / scales).max() < 1e-7


@pytest.mark.parametrize("rate", [1.0, 1e3, 1e6, 1e9])
def test_what_decays_towards_a_moving_value_is_there_at_any_rate(rate: float) -> None:
    """y' = -rate (y - cos t) - sin t has the solution cos t."""
    boundaries = np.linspace(0.0, 3.0, 7)
    starts = np.cos(boundaries[:-1])[:, None]

    def rates(fraction: float, states: Array) -> Array:
        times = boundaries[:-1] + 0.5 * fraction
        return 0.5 * (-rate * (states - np.cos(times)) - np.sin(times))

    found = integrate_elements(rates, starts, np.ones(1), np.linspace(0.0, 1.0, 3), 1e-8)
    assert found is not None
    assert np.abs(found[0][:, 0] - np.cos(boundaries[1:])).max() < 1e-7


def test_what_has_no_motion_is_refused() -> None:
    def blows_up(_: float, states: Array) -> Array:
        return 1e9 * states**2

    halves = np.linspace(0.0, 1.0, 3)
    with np.errstate(all="ignore"):
        assert march_implicitly(blows_up, np.ones((1, 1, 3)), np.ones(1), halves, 1e-8) is None
        assert march_implicitly(lambda _, y: y * np.nan, np.ones((1, 1, 3)), np.ones(1), halves, 1e-8) is None
        assert march_implicitly(blows_up, np.ones((500, 501, 50)), np.ones(500), halves, 1e-8) is None  # too large


@pytest.mark.casadi
def test_the_error_of_a_stiff_motion_is_known() -> None:
    m = pyo.ConcreteModel(name="relaxation")
    m.go = b = rcp.PhaseBlock(duration=2.0, elements=4, stages=2)
    b.x, b.clock = rcp.State(initial=1.0), rcp.State(initial=0.0)
    b.ode(lambda b, t: {b.x: -1e6 * (b.x[t] - pyo.cos(b.clock[t])), b.clock: 1.0})
    m.nothing = pyo.Objective(expr=0.0)
    result = rcp.solve(m, backend="casadi")
    assert result.solved
    error = result.discretisation.motion_error
    assert error is not None
    assert error < 1e-4
    assert "not known" not in result.report()
    assert b.trajectory().verify().element_error < 1e-4
