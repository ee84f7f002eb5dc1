"""The values of a phase as arrays and back, whatever its signals are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.phases.phase_values import PhaseValues

KNOTS = (0.0, 0.5, 2.0)


def model(scheme: Any = "radau", stages: int = 2) -> Any:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=2, mesh=[0, 0.3, 0.5, 1.2, 2.0], scheme=scheme, stages=stages)
    b.x = rcp.State(initial=0, initial_guess=lambda t: t**2, derivative_bounds=(-9, 9))
    b.z = rcp.Algebraic(initial_guess=lambda t: 1 + t)
    b.u = rcp.Control(initial_guess=lambda t: 3 * t)
    b.constant = rcp.Control(parametrization="piecewise_constant", knots=KNOTS, initial_guess=[4, 5])
    b.linear = rcp.Control(parametrization="piecewise_linear", knots=KNOTS, initial_guess=[0, 1, -2])
    b.k = rcp.Parameter(initial_guess=7)
    b.ode(lambda b, t: {b.x: b.u[t] + b.constant[t] + b.linear[t] + b.k * b.z[t]})
    return m


def test_values_are_read_set_and_sampled_where_they_live() -> None:
    m = model()
    b = m.p
    values = PhaseValues(b)
    before = values.read()
    assert {name: len(numbers) for name, numbers in before.items()} == {
        "x": 9, "z": 8, "u": 8, "constant": 2, "linear": 3, "x_derivative": 8
    }  # fmt: skip
    trajectory = values.trajectory(before)
    sampled = values.sampled(trajectory, lambda t: t)
    for name in ("x", "z", "u", "constant", "linear"):
        np.testing.assert_allclose(sampled[name], before[name], atol=1e-12)
    values.set({name: 2 * numbers for name, numbers in before.items()})
    assert b.x[0.0].value == 0  # fixed
    assert b.constant_per_interval[1].value == 10
    assert b.linear_at_knots[2].value == -4
    values.set(before)
    np.testing.assert_allclose(b.trajectory()([0.1, 1.1, 1.9])["linear"], np.interp([0.1, 1.1, 1.9], KNOTS, [0, 1, -2]))


@pytest.mark.parametrize(("scheme", "stages"), [("radau", 1), ("radau", 3), ("gauss", 2)])
def test_nodes_know_what_a_signal_is_at_any_time(scheme: str, stages: int) -> None:
    m = model(scheme, stages)
    b = m.p
    trajectory = b.trajectory()
    for name in ("z", "u", "constant", "linear"):
        nodes = b.record.nodes(name)
        variables = nodes.variables(b)
        for time in (0.0, 0.1, 0.3, 0.5, 0.9, 1.2, 2.0):
            value = sum(weight * variables[i].value for i, weight in nodes.weights_at(time))
            assert value == pytest.approx(trajectory(time)[name], abs=1e-9)
