"""Guesses: whatever the user gives becomes one finite value per variable."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.numerics import Grid, Mesh, gauss_legendre, radau
from pyrobocop_pyomo.transcription import (
    initial_number,
    initial_stage_values,
    initial_state_values,
    initial_values_at,
)


def middles(grid: Grid) -> list[float]:
    return ((np.array(grid.mesh.boundaries[1:]) + grid.mesh.boundaries[:-1]) / 2).tolist()


def element_guess(guess: Any, grid: Grid, name: str) -> Any:
    """Values at the middles of the elements, as a held control takes them."""
    return initial_values_at(guess, middles(grid), name, f"{grid.mesh.elements} elements")


finite = st.floats(-1e6, 1e6)
grids = st.builds(
    lambda scheme, stages, elements: Grid(scheme(stages), Mesh.uniform(-1, 2, elements)),
    st.sampled_from([radau, gauss_legendre]),
    st.integers(1, 4),
    st.integers(1, 6),
)
# How values are made, at which times they are, and how many an array may have else.
KINDS: list[tuple[Callable[..., Any], Callable[[Grid], Any], Callable[[Grid], int]]] = [
    (initial_state_values, lambda grid: grid.times, lambda grid: len(grid.mesh.boundaries)),
    (initial_stage_values, lambda grid: grid.points, lambda grid: grid.mesh.elements),
    (element_guess, middles, lambda grid: grid.mesh.elements),
]


@given(grid=grids, number=finite, data=st.data())
def test_numbers_functions_and_full_arrays_are_values_at_their_times(
    grid: Grid, number: float, data: st.DataObject
) -> None:
    for values, times_of, _ in KINDS:
        times = list(times_of(grid))
        assert values(number, grid, "x").tolist() == [number] * len(times)
        assert values(None, grid, "x").tolist() == [0.0] * len(times)
        assert values(math.exp, grid, "x").tolist() == [math.exp(t) for t in times]
        full = data.draw(st.lists(finite, min_size=len(times), max_size=len(times)))
        for given_values in (tuple(full), np.array(full)):
            assert values(given_values, grid, "x").tolist() == full
    assert (initial_number(number, "x"), initial_number(None, "x")) == (number, 0)


@given(grid=grids, slope=finite, offset=finite)
def test_fewer_values_are_joined_by_lines_or_stay_over_an_element(grid: Grid, slope: float, offset: float) -> None:
    line = slope * np.array(grid.times) + offset
    ends = [slope * t + offset for t in grid.mesh.boundaries]
    np.testing.assert_allclose(initial_state_values(ends, grid, "x"), line, atol=1e-9 * (1 + abs(slope)))
    each = ends[1:]
    assert initial_stage_values(each, grid, "x").tolist() == [each[grid.element_of[t]] for t in grid.points]


@given(grid=grids, length=st.integers(0, 40))
def test_other_lengths_are_refused_with_both_numbers(grid: Grid, length: int) -> None:
    for values, times_of, coarser in KINDS:
        lengths = {len(times_of(grid)), coarser(grid)}
        if length in lengths:
            assert len(values([0.5] * length, grid, "x")) == max(lengths)
            continue
        needed = " or ".join(map(str, sorted(lengths)))
        message = f"x: the initial guess has {length} values; .* need {needed}. Give {needed}"
        with pytest.raises(InitialGuessError, match=message):
            values([0.5] * length, grid, "x")


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
        initial_state_values(wrong, Grid(radau(2), Mesh.uniform(0, 1, 3)), "x")


@pytest.mark.parametrize(
    ("wrong", "message"), [([1, 2], "has 2 values; one number need 1"), (math.sin, "is a function of time")]
)
def test_one_number_is_needed_where_nothing_changes_in_time(wrong: Any, message: str) -> None:
    with pytest.raises(InitialGuessError, match=message):
        initial_number(wrong, "x")
