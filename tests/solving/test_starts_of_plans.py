"""Which starts are tried for a plan around obstacles, in which order, and with what on the model."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.planning.recovery import Recovery


def through_a_wall(**avoidance: Any) -> pyo.ConcreteModel:
    """A box, a wall with an opening at y = 1.2, and a straight guess beside it."""
    m = pyo.ConcreteModel(name="through a wall")
    m.move = b = rcp.PhaseBlock(duration=5.0, elements=12, stages=2)
    for name, last in (("x", 2), ("y", 0), ("theta", 0)):
        b.declare(name, rcp.State(initial=-2 if name == "x" else 0, final=last))
        b.declare(f"{name}_rate", rcp.Control(bounds=(-9, 9)))
    b.ode(lambda b, t: {b.x: b.x_rate[t], b.y: b.y_rate[t], b.theta: b.theta_rate[t]})
    b.initialize_straight_lines()
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        body=rcp.Polytope.box(0.4, 0.2),
        pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.theta[t]),
        obstacles=[rcp.Polytope.box(0.1, 10.0, center=(0, 1.2 + side * 5.4)) for side in (-1, 1)],
        clearance=0.05,
        **avoidance,
    )
    return m


class Fails:
    """A planning in which nothing is ever feasible, and which writes down what it was asked to solve."""

    def __init__(self, model: pyo.ConcreteModel) -> None:
        self.model = model
        self.told: dict[str, float] = {}

    def solve(self, purpose: str, **_: Any) -> Any:
        b = self.model.move
        middle = min(b.time, key=lambda t: abs(b.x[t].value))
        self.told[purpose] = b.y[middle].value
        return SimpleNamespace(
            constraint_violation=1.0, quality=rcp.Quality.INFEASIBLE, stop_reason=rcp.StopReason.ITERATION_LIMIT
        )

    def may_go_on(self, result: Any) -> bool:
        return True

    def seconds_left(self) -> float:
        return math.inf

    def solve_without_obstacles(self) -> bool:
        return False


def told(model: pyo.ConcreteModel) -> dict[str, float]:
    planning = Fails(model)
    recovery = Recovery(model, [model.move.avoid], [], planning)
    recovery.start()
    for step in recovery.steps():
        step()
    return planning.told


def test_the_guess_comes_first_then_one_that_is_led_around_and_others_start_from_the_users_again() -> None:
    starts = told(through_a_wall())
    assert list(starts)[:2] == ["from the initial guess", "led around all obstacles"]
    assert starts["from the initial guess"] == 0.0
    assert starts["led around all obstacles"] == pytest.approx(1.2, abs=0.25)
    assert next(height for purpose, height in starts.items() if "degrees round" in purpose) == 0.0
    assert list(starts)[-1] == "from the initial guess, to the end"  # the first solve was cut short


def test_margins_of_another_motion_are_forgotten() -> None:
    m = through_a_wall()
    index = m.move.avoid.separations.first()
    recovery = Recovery(m, [m.move.avoid], [], Fails(m))
    m.move.avoid.set_margin(*index, 0.3)
    recovery.start()
    for step, _ in zip(recovery.steps(), range(2), strict=False):
        step()
        assert pyo.value(m.move.avoid.margin[index]) == 0.0
        m.move.avoid.set_margin(*index, 0.3)
