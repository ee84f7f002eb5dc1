"""Guesses through waypoints."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import InitialGuessError


def phase(duration: Any = 2.0, **options: Any) -> Any:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=duration, elements=20, **options)
    b.x, b.y, b.theta = rcp.State(), rcp.State(), rcp.State()
    return b


points = st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=2, max_size=6)


@given(points=points, duration=st.sampled_from([2.0, rcp.Duration(bounds=(1, 9), initial_guess=3)]))
def test_the_guess_goes_through_the_waypoints_at_an_even_speed(points: Any, duration: Any) -> None:
    b = phase(duration, start=1.0)
    x, y = np.array(points).T
    guess = rcp.scenes.waypoint_initial_guess(b, {"x": x, b.y: y})
    first, last = b.time.first(), b.time.last()
    times = np.linspace(first, last, 401)
    path = np.array([[guess["x"](t), guess["y"](t)] for t in times])
    assert path[[0, -1]].ravel().tolist() == pytest.approx([x[0], y[0], x[-1], y[-1]])
    lengths = np.hypot(np.diff(x), np.diff(y))
    if (total := lengths.sum()) > 1e-3:
        steps = np.hypot(*np.diff(path, axis=0).T) * 400 / total
        # Even but for steps that cut a corner, of which there are as many as corners.
        assert steps.max() <= 1 + 1e-9
        assert np.count_nonzero(steps < 1 - 1e-9) <= len(points)
        for reached, here in zip(np.concatenate([[0.0], np.cumsum(lengths)]) / total, points, strict=True):
            t = first + reached * (last - first)
            assert [guess["x"](t), guess["y"](t)] == pytest.approx(here, abs=1e-6)
    b.initialize(guess)
    assert b.y[last].value == pytest.approx(y[-1])


def test_angles_need_not_count() -> None:
    b = phase()
    guess = rcp.scenes.waypoint_initial_guess(b, {"x": [0, 1, 4], "theta": [0, 100, 0]}, even_in=["x"])
    assert [guess["theta"](t) for t in (0, 0.5, 2)] == [0, 100, 0]
    turning = rcp.scenes.waypoint_initial_guess(b, {"x": [1, 1, 1], "theta": [0, 1, 0]}, even_in=["x"])
    assert [turning["theta"](t) for t in (0, 1, 2)] == [0, 1, 0]


@pytest.mark.parametrize(
    ("waypoints", "options", "message"),
    [
        ({}, {}, "expected one list per state"),
        ({"x": [1]}, {}, "two values or more"),
        ({"x": [1, 2], "y": [1, 2, 3]}, {}, "waypoints: expected numbers"),
        ({"x": [1, np.nan]}, {}, "is not finite"),
        ({"z": [1, 2]}, {}, "for 'z', which it does not have"),
        ({"x": [1, 2]}, {"even_in": ["y"]}, "even_in has y; waypoints are given for x"),
    ],
)
def test_waypoints_that_do_not_fit_are_refused(waypoints: Any, options: Any, message: str) -> None:
    with pytest.raises(InitialGuessError, match=message):
        rcp.scenes.waypoint_initial_guess(phase(), waypoints, **options)


def test_only_a_phase_has_a_horizon() -> None:
    with pytest.raises(InitialGuessError, match="is no PhaseBlock"):
        rcp.scenes.waypoint_initial_guess(pyo.ConcreteModel(name="plain"), {"x": [0, 1]})
