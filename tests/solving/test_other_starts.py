"""With pairs: other starts before a problem is called infeasible."""

from __future__ import annotations

from math import pi

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi


def pendulum_between_walls(**guess: float) -> pyo.ConcreteModel:
    """It swings up between two soft walls."""
    m = pyo.ConcreteModel(name="pendulum")
    m.swing = b = rcp.PhaseBlock(duration=3.0, elements=40, scheme="implicit_euler")
    b.angle, b.speed = rcp.State(initial=pi, final=0.0, **guess), rcp.State(initial=0.0, final=0.0)
    b.torque = rcp.Control(bounds=(-4, 4))
    b.left, b.right = rcp.Control(bounds=(0, None)), rcp.Control(bounds=(0, None))

    @b.ode
    def motion(b, t):
        fall = 9.81 * pyo.sin(b.angle[t]) - 0.1 * b.speed[t]
        return {"angle": b.speed[t], "speed": fall + b.torque[t] + b.left[t] - b.right[t]}

    @b.complementarity
    def walls(b, t):
        side = pyo.sin(b.angle[t])
        return [
            rcp.complements(b.left[t] >= 0, b.left[t] / 200 + side + 0.6 >= 0),
            rcp.complements(b.right[t] >= 0, b.right[t] / 200 - side + 0.6 >= 0),
        ]

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.torque[t] ** 2))
    return m


def test_a_start_at_rest_does_not_make_a_problem_infeasible() -> None:
    """No strategy gets further from there than local infeasibility, which says nothing of the problem."""
    stated = rcp.solve(pendulum_between_walls(), progress=False)
    elsewhere = rcp.solve(pendulum_between_walls(initial_guess=pi), progress=False)
    assert stated.solved
    assert elsewhere.solved
    assert elsewhere.objective <= stated.objective * (1 + 1e-6)
    assert elsewhere.strategy == "straight lines"


def test_what_is_infeasible_is_still_said_to_be() -> None:
    m = pendulum_between_walls()
    m.swing.torque.setub(0.01)
    m.swing.torque.setlb(-0.01)
    result = rcp.solve(m, progress=False)
    assert result.quality is rcp.Quality.INFEASIBLE
