"""A rough motion as a start: near the simulated one, and none where there is no moderate motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.phases.simulation import put_rough_motion
from pyrobocop_pyomo.solving import starts


def swing(scheme: str = "radau", duration: Any = 2.0) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=duration, elements=20, scheme=scheme)
    b.angle, b.speed = rcp.State(initial=0.5), rcp.State(initial=0)
    b.damping = rcp.Parameter(initial_guess=0.3)
    b.torque = rcp.Control(initial_guess=lambda t: 1 + t**2)
    b.ode(
        lambda b, t: {
            b.angle: b.speed[t],
            b.speed: b.torque[t] - 9.81 * pyo.sin(b.angle[t]) - b.damping * b.speed[t],
        }
    )
    return m


@pytest.mark.parametrize("scheme", ["radau", "gauss", "lobatto", "implicit_euler"])
@pytest.mark.parametrize("duration", [2.0, rcp.Duration(bounds=(1, 5), initial_guess=3)])
def test_it_is_the_simulated_motion_to_plotting_accuracy(scheme: str, duration: Any) -> None:
    m = swing(scheme, duration)
    exact = m.p.simulate()
    assert put_rough_motion(m.p)
    for name in ("angle", "speed"):
        found = np.array([m.p.component(name)[t].value for t in m.p.time])
        assert np.abs(found - exact.states[name]).max() < 1e-2


def test_a_motion_that_explodes_changes_nothing() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=5, elements=5)
    b.x, b.u = rcp.State(initial=1, initial_guess=0.5), rcp.Control(initial_guess=1)
    b.ode(lambda b, t: {b.x: b.x[t] ** 3 + b.u[t]})
    before = [v.value for v in b.x.values()]
    assert not put_rough_motion(b)
    assert [v.value for v in b.x.values()] == before


def test_a_state_without_an_explicit_equation_has_none() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=1, elements=3)
    b.x, b.u = rcp.State(initial=1), rcp.Control(initial_guess=1)
    b.residual(lambda b, t: b.derivative("x")[t] * (1 + b.x[t]) == b.u[t])
    assert not put_rough_motion(b)


def test_algebraics_keep_their_values() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=1, elements=3)
    b.x, b.y = rcp.State(initial=0), rcp.Algebraic(initial_guess=2.0)
    b.ode(lambda b, t: {b.x: b.y[t]})
    b.residual(lambda b, t: b.y[t] == 1 + b.x[t])
    assert put_rough_motion(b)
    assert b.x[b.final_time].value == pytest.approx(2.0)
    assert {v.value for v in b.y.values()} == {2.0}


@pytest.mark.parametrize("with_algebraic", [False, True])
def test_a_start_moves_roughly_unless_there_is_more_to_find_than_states(with_algebraic: bool, monkeypatch) -> None:
    m, simulated = swing(), []
    if with_algebraic:
        m.p.power = rcp.Algebraic()
        m.p.residual(lambda b, t: b.power[t] == b.torque[t] * b.speed[t], name="power_of_torque")

    def simulate(*arguments: Any) -> rcp.Trajectory:
        simulated.append(arguments[0])
        return simulation(*arguments)

    simulation = starts.simulate
    monkeypatch.setattr(starts, "simulate", simulate)
    exact = m.p.simulate()
    assert starts.put_motion(m)
    found = np.array([m.p.angle[t].value for t in m.p.time])
    assert np.abs(found - exact.angle).max() < 1e-2
    assert len(simulated) == with_algebraic
