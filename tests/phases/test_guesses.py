"""Guesses: whatever the user gives becomes one finite value per variable."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.numerics import Grid, Mesh, gauss_legendre, radau
from pyrobocop_pyomo.phases.nodes import IntervalNodes, Nodes, StageNodes, StateNodes, initial_number

finite = st.floats(-1e6, 1e6)
grids = st.builds(
    lambda scheme, stages, elements: Grid(scheme(stages), Mesh.uniform(-1, 2, elements)),
    st.sampled_from([radau, gauss_legendre]),
    st.integers(1, 4),
    st.integers(1, 6),
)


def each_kind(grid: Grid) -> list[tuple[Nodes, int]]:
    """Where values live, and how many an array may have else."""
    held = IntervalNodes("x", grid, grid.mesh.boundaries)
    elements = grid.mesh.elements
    return [(StateNodes("x", grid), elements + 1), (StageNodes("x", grid), elements), (held, elements)]


@given(grid=grids, number=finite, data=st.data())
def test_numbers_functions_and_full_arrays_are_values_at_their_times(
    grid: Grid, number: float, data: st.DataObject
) -> None:
    for nodes, _ in each_kind(grid):
        times = list(nodes.times)
        assert nodes.from_guess(number, "x") == pytest.approx([number] * len(times))
        assert nodes.from_guess(None, "x").tolist() == [0.0] * len(times)
        assert nodes.from_guess(math.exp, "x") == pytest.approx([math.exp(t) for t in times])
        full = data.draw(st.lists(finite, min_size=len(times), max_size=len(times)))
        for given_values in (tuple(full), np.array(full)):
            assert nodes.from_guess(given_values, "x").tolist() == full
    assert (initial_number(number, "x"), initial_number(None, "x")) == (number, 0)


@given(grid=grids, slope=finite, offset=finite)
def test_fewer_values_are_joined_by_lines_or_stay_over_an_element(grid: Grid, slope: float, offset: float) -> None:
    line = slope * np.array(grid.times) + offset
    ends = [slope * t + offset for t in grid.mesh.boundaries]
    (of_state, _), (of_stages, _), _ = each_kind(grid)
    np.testing.assert_allclose(of_state.from_guess(ends, "x"), line, atol=1e-9 * (1 + abs(slope)))
    each = ends[1:]
    assert of_stages.from_guess(each, "x").tolist() == [each[grid.element_of[t]] for t in grid.points]


@given(grid=grids, length=st.integers(0, 40))
def test_other_lengths_are_refused_with_both_numbers(grid: Grid, length: int) -> None:
    for nodes, coarser in each_kind(grid):
        lengths = {len(nodes.times), coarser}
        if length in lengths:
            assert len(nodes.from_guess([0.5] * length, "x")) == max(lengths)
            continue
        needed = " or ".join(map(str, sorted(lengths)))
        message = f"x: the initial guess has {length} values; .* need {needed}. Give {needed}"
        with pytest.raises(InitialGuessError, match=message):
            nodes.from_guess([0.5] * length, "x")


NOT_FINITE = r"x: value [02] of the initial guess is -?(nan|inf); initial guesses must be finite"
NO_NUMBER = "x: the initial guess is not made of numbers"


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        *((wrong, NOT_FINITE) for wrong in (math.nan, math.inf, [0, 1, math.nan, 3], lambda t: -math.inf)),
        *((wrong, NO_NUMBER) for wrong in ("1.5", "fast", {0: 1}, [1, [2, 3], 4], 1j, object())),
        *((wrong, NO_NUMBER) for wrong in (lambda t: "a", lambda t: None)),
    ],
)
def test_what_is_no_finite_number_is_refused(wrong: Any, message: str) -> None:
    with pytest.raises(InitialGuessError, match=message):
        StateNodes("x", Grid(radau(2), Mesh.uniform(0, 1, 3))).from_guess(wrong, "x")


# --------------------------------------------------------------------
# Guesses through waypoints.


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
