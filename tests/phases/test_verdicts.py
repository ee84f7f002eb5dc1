"""The verdict on a trajectory says what holds, and why an error that grows over the horizon need not matter."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.ipopt


def falling(rate: float, *, elements: int = 10, **options: Any) -> Any:
    """A model, and the motion of x' = rate * x + u at u = 0 by the scheme of its phase."""
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=10.0, elements=elements, **options)
    b.x, b.u = rcp.State(initial=1), rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.x: rate * b.x[t] + b.u[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    assert rcp.solve(m, mesh_tolerance=None).solved
    return m, b.trajectory()


def test_what_is_integrated_by_the_scheme_holds():
    m, motion = falling(-0.3)
    verdict = motion.verify(m.p).verdict
    assert verdict.startswith("Verdict: equations and bounds hold at the points of the mesh")
    assert "each element follows its equations" in verdict
    assert "horizon" not in verdict
    assert str(motion.verify(m.p)).endswith(verdict)


def test_what_was_changed_does_not_hold():
    m, plan = falling(-0.3)
    moved = replace(plan, states={"x": plan.states["x"] + np.linspace(0, 1, len(plan.time))})
    assert "does NOT hold: the equations of motion are violated by" in moved.verify(m.p).verdict


def test_a_coarse_mesh_is_named():
    m, motion = falling(-3.0, elements=3, scheme="implicit_euler")
    verdict = motion.verify(m.p).verdict
    assert "the mesh is coarse" in verdict
    assert "Take more elements." in verdict


def test_an_error_that_grows_over_the_horizon_is_explained():
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=10.0, elements=20)
    b.x = rcp.State(initial=0.1, final=0)
    b.v = rcp.State(initial=0, final=0)
    b.u = rcp.Control(bounds=(-5, 5))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: 10 * pyo.sin(b.x[t]) + b.u[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    assert rcp.solve(m).solved
    found = b.trajectory().verify()
    assert found.horizon_error > 1e3 * found.element_error
    assert "since the motion is unstable" in found.verdict
    assert "harmless where a controller or replanning corrects" in found.verdict
