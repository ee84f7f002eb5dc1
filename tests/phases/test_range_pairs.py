"""Ranges and equalities stated in a phase: dry friction, which needs one range where it took two pairs before."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.phases import one_phase

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.asl


def sliding(speed: float = 1.0) -> Any:
    """A unit mass under friction between -1 and 1: it slows down by 1 per second, and then it stays where it is."""
    m, b = one_phase(model="sliding", duration=2, elements=20, scheme="implicit_euler", position=rcp.State(initial=0))
    b.speed = rcp.State(initial=speed, initial_guess=speed)
    b.friction = rcp.Algebraic(bounds=(-1, 1), initial_guess=0)
    b.half = rcp.Algebraic(initial_guess=0)
    b.ode(lambda b, t: {b.position: b.speed[t], b.speed: b.friction[t]})

    b.complementarity(lambda b, t: rcp.complements(b.friction[t], b.speed[t]), name="stick_or_slip")

    b.complementarity(lambda b, t: rcp.complements(2 * b.half[t] == b.speed[t], b.friction[t]), name="definition")

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.friction[t] ** 2))
    return m


@pytest.mark.parametrize("sign", [1, -1])
def test_dry_friction_is_one_range(sign: int) -> None:
    m = sliding(sign * 1.0)
    solution(m)
    trajectory = m.p.trajectory()
    expected = sign * np.maximum(1 - trajectory.time, 0)
    assert trajectory.speed == pytest.approx(expected, abs=1e-3)
    assert trajectory.half == pytest.approx(expected[1:] / 2, abs=1e-3)


def test_both_parts_are_in_the_trajectory_and_are_verified() -> None:
    m = sliding()
    rcp.solve(m).raise_for_status()
    trajectory = m.p.trajectory()
    names = {name for name in trajectory.pairs if name.startswith("stick_or_slip")}
    assert names == {"stick_or_slip (lower)", "stick_or_slip (upper)"}
    assert "definition" not in trajectory.pairs
    above, forward = trajectory.pairs["stick_or_slip (lower)"]
    assert np.nanmin(above) >= -1e-6
    assert np.nanmax(np.minimum(above, forward)) <= 1e-3
    verdict = trajectory.verify()
    assert verdict.product <= 1e-6
    m.p.half[m.p.initial_time + 1].set_value(7)
    assert m.p.trajectory().verify().equations > 1
