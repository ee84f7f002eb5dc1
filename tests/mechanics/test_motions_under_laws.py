"""Motions under contact laws whose course is known: solved from a guess that is wrong."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

LAWS = rcp.mechanics
pytestmark = pytest.mark.ipopt


def solved(b: rcp.PhaseBlock) -> rcp.Trajectory:
    """The motion: everything that is free starts at a tenth."""
    m = b.model()
    m.nothing = pyo.Objective(expr=0)
    for variable in b.component_data_objects(pyo.Var):
        if not variable.fixed:
            variable.set_value(0.1, skip_validation=True)
    rcp.solve(m).raise_for_status()
    trajectory = b.trajectory()
    verified = trajectory.verify()
    assert max(verified.natural_residual, verified.equations, verified.defect) < 1e-7
    simulated = b.simulate()
    for name in b.record.names_of_states:
        assert getattr(simulated, name) == pytest.approx(getattr(trajectory, name), abs=1e-5), name
    return trajectory


def phase(duration: float, elements: int) -> rcp.PhaseBlock:
    m = pyo.ConcreteModel("motion")
    m.phase = rcp.PhaseBlock(duration=duration, elements=elements, scheme="implicit_euler")
    return m.phase


@pytest.mark.parametrize("push", [3.0, 6.0])
def test_a_block_slides_until_friction_holds_it(push: float) -> None:
    """Friction bears 4 N: with less than that it comes to rest, with more it goes on faster and faster."""
    b = phase(2.0, 10)
    b.v = rcp.State(initial=1.5)
    b.floor = LAWS.CoulombFriction(b.v, normal=8.0, coefficient=0.5)
    b.ode(lambda b, t: {b.v: push + b.floor[t]})
    found = solved(b)
    times = np.linspace(0, 2, 11)
    assert found.v == pytest.approx(np.maximum(1.5 + (push - 4.0) * times, 0), abs=1e-6)
    if push < 4:
        assert found.floor[-1] == pytest.approx(-push, abs=1e-6)  # what is needed, no more


@pytest.mark.parametrize("stiffness", [None, 500.0])
def test_a_stone_falls_on_a_floor_and_rubs_along_it(stiffness: float | None) -> None:
    """Without friction it would go on; with it, it loses as much speed along as the coefficient times that across."""
    b = phase(1.0, 20)
    for name, initial in (("x", 0.0), ("z", 0.5), ("u", 3.0), ("w", 0.0)):
        b.declare(name, rcp.State(initial=initial))
    b.floor = LAWS.HardWall(b.z) if stiffness is None else LAWS.SoftWall(b.z, stiffness)
    b.rubbing = LAWS.CoulombFriction(b.u, normal=b.floor, coefficient=0.4)

    @b.ode
    def newton(b: Any, t: float) -> dict[Any, Any]:
        return {b.x: b.u[t], b.z: b.w[t], b.u: b.rubbing[t], b.w: b.floor[t] - 9.81}

    found = solved(b)
    assert (found.rubbing >= -0.4 * found.floor - 1e-7).all()
    pressed = float(found.floor.sum() * 0.05)
    assert found.u[-1] == pytest.approx(max(3.0 - 0.4 * pressed, 0.0), abs=1e-6)
    if stiffness is None:
        assert found.z.min() >= -1e-7
        assert found.w[-1] == pytest.approx(0.0, abs=1e-7)  # the impact of implicit Euler is inelastic
        assert pressed == pytest.approx(9.81, abs=1e-6)  # over the second: all of its weight
