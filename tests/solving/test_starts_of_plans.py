"""Which starts are tried for a plan around obstacles, in which order, and with what on the model."""

from types import SimpleNamespace

import pyomo.environ as pyo
import pytest
from harness.scenes import through_a_wall

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE
from pyrobocop_pyomo.planning.recovery import Recovery

IN_VAIN = SimpleNamespace(
    results=[SimpleNamespace(stop_reason=rcp.StopReason.ITERATION_LIMIT)],
    deadline=NO_DEADLINE,
)


def test_the_guess_comes_first_then_one_that_is_led_around_and_others_start_from_the_users_again() -> None:
    m = through_a_wall(end=(2, 0, 0))
    b = m.move
    recovery = Recovery(m, IN_VAIN)
    recovery.start()
    middle = min(b.time, key=lambda t: abs(b.x[t].value))
    heights = {start.purpose: b.y[middle].value for start in recovery.starts()}
    assert list(heights)[:2] == ["from the initial guess", "led around all obstacles"]
    assert heights["from the initial guess"] == 0.0
    assert heights["led around all obstacles"] == pytest.approx(1.2, abs=0.25)
    assert list(heights)[-1] == "from the initial guess, to the end"  # the first solve was cut short
    assert heights["from the initial guess, to the end"] == 0.0


def test_margins_of_another_motion_are_forgotten() -> None:
    m = through_a_wall(end=(2, 0, 0))
    index = m.move.avoid.separations.first()
    recovery = Recovery(m, IN_VAIN)
    m.move.avoid.set_margin(*index, 0.3)
    recovery.start()
    for _ in recovery.starts():
        assert pyo.value(m.move.avoid.margin[index]) == 0.0
        m.move.avoid.set_margin(*index, 0.3)
