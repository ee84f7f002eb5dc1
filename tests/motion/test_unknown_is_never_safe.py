"""What is not known of the motion under the controls is clear at best, never safe, and the first lines say so."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import with_phase
from harness.scenes import keep_clear, on_the_line, post

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import TrajectoryError

pytestmark = pytest.mark.ipopt

CLEAR = "clear; the motion under the controls was not replayed"

State = Callable[[Any, Any, Any], Any]


def mover(drift: State, prepare: Callable[[Any], None] = lambda m: None) -> Any:
    """A point that drives along a wall, with a drift to the side."""
    m, b = with_phase("drive", "mover", duration=1.0, elements=6, scheme="radau", stages=2)
    b.x, b.y, b.u = rcp.State(initial=0), rcp.State(initial=0), rcp.Control(bounds=(-3, 3))
    prepare(m)
    b.ode(lambda b, t: {b.x: 1.0, b.y: b.u[t] + drift(m, b, t)})
    keep_clear(b, rcp.Polytope.box(0.05, 0.05), {"wall": rcp.Polytope.box(4.0, 0.1, center=(0.5, 0.3))})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + b.y[t] ** 2))
    return m


def _dictionary(m: Any) -> None:
    m.given = {t: 0.2 for t in m.drive.points}  # noqa: C420


def _fixed(m: Any) -> None:
    m.given = pyo.Var(list(m.drive.points), initialize=0.2)
    m.given.fix()


@pytest.mark.parametrize(
    ("drift", "prepare"),
    [
        (lambda m, b, t: m.given[t], _dictionary),
        (lambda m, b, t: m.given[t], _fixed),
        (lambda m, b, t: 0.1 * b.y.delayed(t, 0.05), lambda m: None),
    ],
    ids=["dictionary", "fixed variable", "delay without history"],
)
def test_equations_that_are_known_at_their_points_only(drift: State, prepare: Callable[[Any], None]) -> None:
    m = mover(drift, prepare)
    result = rcp.solve(m, progress=False)
    assert result.safe is None
    assert result.solved
    assert len(result.rounds) == 1  # no other plan could be proven better
    for text in (str(result), result.report(), result.one_line(), result._repr_html_(), str(result.safety)):
        assert "clear; the motion under the controls was not replayed" in text
        assert "safe" not in text.split(CLEAR)[0].lower().replace(Path(__file__).name, "")
    # The plan alone, where somebody says that it is tracked.
    m.drive.avoid.equations = False
    alone = rcp.solve(m, progress=False)
    assert alone.safe is None
    assert "equations=False" in str(alone).splitlines()[0]


@pytest.mark.parametrize(
    "is_on",
    [
        lambda t: 0.51 < pyo.value(2 * t) / 2 < 0.65,
        lambda t: str(t).startswith("0.5"),
        lambda t: isinstance(t, float) and 0.51 < t < 0.65,
        lambda t: t > 0.5,
    ],
    ids=["value of a formula", "text", "class", "jump"],
)
def test_of_a_rule_that_takes_t_for_a_number_no_motion_is_known(is_on: Callable[[Any], bool]) -> None:
    """The points of the mesh miss the pulses; nobody says what the rule says between them."""
    m = mover(lambda m, b, t: 3.0 if is_on(t) else 0.0)
    m.drive.initialize(x=lambda t: t, y=0.0, u=0.0)
    report = m.drive.avoid.verify()
    assert report.safe is None
    assert CLEAR in str(report)
    assert "has to know the time as a number" in str(report)
    with pytest.raises(TrajectoryError, match="has to know the time as a number"):
        m.drive.simulate()


def test_a_time_index_without_real_time_is_compared_too() -> None:
    """Rates are by real time, also where the indices of the phase are not."""
    _, b = with_phase("drive", duration=rcp.Duration(bounds=(1, 4), initial_guess=2.0), elements=5)
    b.x, b.y = rcp.State(initial=0), rcp.State(initial=0)
    b.ode(lambda b, t: {b.x: 1.0 + 0.1 * b.time_at(t), b.y: -b.y[t] + b.x[t]})
    b.initialize(b.simulate())
    keep_clear(b, rcp.Polytope.box(0.05, 0.05), post(9.0, 0.0))
    assert b.avoid.verify().safe


def test_what_was_safe_is_not_known_once_the_model_has_changed() -> None:
    m = mover(lambda m, b, t: m.wind, lambda m: m.add_component("wind", pyo.Param(initialize=0.1, mutable=True)))
    result = rcp.solve(m, progress=False)
    assert result.safe is True
    m.wind = 0.4
    assert result.safe is None
    assert "CHANGED" in str(result)
    assert "CHANGED" in result.one_line()
    assert result.safety.safe  # the record of what was
    m.wind = 0.1
    assert result.safe is True
    m.drive.y[1.0].set_value(0.1)
    assert result.safe is None
    assert pickle.loads(pickle.dumps(result)).safe is True  # a record, which knows no model


def test_where_no_equations_are_stated_the_plan_is_the_motion() -> None:
    _, b = with_phase("drive", duration=1.0, elements=3)
    b.x, b.y = rcp.State(initial=0), rcp.Control(initial_guess=0.0)
    b.constraint(lambda b, t: b.derivative(b.x)[t] <= 1.0, name="slow")
    b.initialize(x=0.0)
    keep_clear(b, rcp.Polytope.box(0.05, 0.05), post(0.0, 1.0), on_the_line)
    assert b.avoid.verify().safe
    b.constraint(lambda b, t: b.derivative(b.x)[t] == b.y[t], name="follows")
    assert b.avoid.verify().safe
    b.initialize(y=1.0)
    assert not b.avoid.verify().safe  # the equation leads a metre away
