"""Problems as somebody states them who has just read the documentation."""

from __future__ import annotations

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi


def test_state_that_passes_its_bound_between_the_points_is_named():
    """A hop with the best apex: the squat ends between two points, so that the plan is better than any true one."""
    m = pyo.ConcreteModel(name="hop")
    m.stance = a = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.05, 1)), elements=10)
    a.height = rcp.State(initial=0.6, bounds=(0.4, 1.0), final=1.0)
    a.speed = rcp.State(initial=0)
    a.push = rcp.Control(bounds=(0, 30), parametrization="piecewise_constant")
    a.ode(lambda b, t: {b.height: b.speed[t], b.speed: b.push[t] - 9.81})
    m.flight = f = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.05, 2)), elements=2)
    f.height, f.speed = rcp.State(), rcp.State(final=0)
    f.ode(lambda b, t: {b.height: b.speed[t], b.speed: -9.81})
    m.lift_off = rcp.Link(a, f)
    m.apex = pyo.Objective(expr=f.height[f.final_time], sense=pyo.maximize)
    result = rcp.solve(m, progress=False)
    result.raise_for_status()
    # The fall ends where full thrust just stops it at 0.4; from there on the thrust does work up to the height 1.
    turn = (9.81 * 0.6 + (30 - 9.81) * 0.4) / 30
    best = 0.6 + 30 * (1 - turn) / 9.81
    passed = a.trajectory().verify().bounds_passed
    assert set(passed) == {"height"}
    assert 0 < result.objective - best < 30 / 9.81 * passed["height"].excess
    assert "'height' passes its bound 0.4" in str(result)
    assert "'height' passes its bound 0.4" in str(a.trajectory().verify())
    assert not f.trajectory().verify().bounds_passed


def test_control_that_jumps_and_passes_its_bound_between_the_points_is_named():
    def rest_to_rest(parametrization):
        m = pyo.ConcreteModel(name="rest to rest")
        m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 9), initial_guess=2), elements=7)
        b.x, b.v = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
        b.u = rcp.Control(bounds=(-1, 1), parametrization=parametrization)
        b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
        m.time = pyo.Objective(expr=b.duration)
        result = rcp.solve(m, progress=False, mesh_tolerance=None, strategies=rcp.Strategy(exploration=0))
        result.raise_for_status()
        return b.trajectory().verify().bounds_passed, str(result)

    passed, text = rest_to_rest("collocated")
    assert passed["u"].excess > 0.01
    assert "'u' passes its bound" in text
    assert "parametrization='piecewise_constant' for a control" in text
    passed, text = rest_to_rest("piecewise_constant")
    assert "u" not in passed
    assert "passes its bound" not in text
