"""Which starts are tried for a plan around obstacles, in which order, and with what on the model."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.scenes import through_a_wall

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE
from pyrobocop_pyomo.planning.recovery import Recovery


class Fails:
    """A planning in which nothing is ever feasible, and which writes down what it was asked to solve."""

    deadline = NO_DEADLINE

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

    def solve_without_obstacles(self) -> bool:
        return False


def told(model: pyo.ConcreteModel) -> dict[str, float]:
    planning = Fails(model)
    recovery = Recovery(model, planning)
    recovery.start()
    for step in recovery.steps():
        step()
    return planning.told


def test_the_guess_comes_first_then_one_that_is_led_around_and_others_start_from_the_users_again() -> None:
    starts = told(through_a_wall(end=(2, 0, 0)))
    assert list(starts)[:2] == ["from the initial guess", "led around all obstacles"]
    assert starts["from the initial guess"] == 0.0
    assert starts["led around all obstacles"] == pytest.approx(1.2, abs=0.25)
    assert next(height for purpose, height in starts.items() if "degrees round" in purpose) == 0.0
    assert list(starts)[-1] == "from the initial guess, to the end"  # the first solve was cut short


def test_margins_of_another_motion_are_forgotten() -> None:
    m = through_a_wall(end=(2, 0, 0))
    index = m.move.avoid.separations.first()
    recovery = Recovery(m, Fails(m))
    m.move.avoid.set_margin(*index, 0.3)
    recovery.start()
    for step, _ in zip(recovery.steps(), range(2), strict=False):
        step()
        assert pyo.value(m.move.avoid.margin[index]) == 0.0
        m.move.avoid.set_margin(*index, 0.3)
