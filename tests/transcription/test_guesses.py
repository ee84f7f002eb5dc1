"""Guesses: whatever the user gives becomes one finite value per variable."""

import math

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


def element_guess(guess, grid: Grid, name: str):
    """Values at the middles of the elements, as a held control takes them."""
    middles = (np.array(grid.mesh.boundaries[1:]) + grid.mesh.boundaries[:-1]) / 2
    return initial_values_at(guess, middles.tolist(), name, f"{grid.mesh.elements} elements")


finite = st.floats(-1e6, 1e6)
grids = st.builds(
    lambda scheme, stages, elements: Grid(scheme(stages), Mesh.uniform(-1, 2, elements)),
    st.sampled_from([radau, gauss_legendre]),
    st.integers(1, 4),
    st.integers(1, 6),
)


@given(grid=grids, number=finite)
def test_a_number_is_the_guess_everywhere(grid: Grid, number: float) -> None:
    assert initial_state_values(number, grid, "x").tolist() == [number] * len(grid.times)
    assert initial_stage_values(number, grid, "x").tolist() == [number] * len(grid.points)
    assert element_guess(number, grid, "x").tolist() == [number] * grid.mesh.elements
    assert initial_number(number, "x") == number


@given(grid=grids)
def test_no_guess_is_zero(grid: Grid) -> None:
    assert not initial_state_values(None, grid, "x").any()
    assert not initial_stage_values(None, grid, "x").any()
    assert not element_guess(None, grid, "x").any()
    assert initial_number(None, "x") == 0


@given(grid=grids)
def test_a_function_is_asked_at_the_times_of_the_values(grid: Grid) -> None:
    assert initial_state_values(math.exp, grid, "x").tolist() == [math.exp(t) for t in grid.times]
    assert initial_stage_values(math.exp, grid, "x").tolist() == [math.exp(t) for t in grid.points]
    middles = (np.array(grid.mesh.boundaries[1:]) + grid.mesh.boundaries[:-1]) / 2
    assert element_guess(math.exp, grid, "x") == pytest.approx(np.exp(middles))


@given(grid=grids, slope=finite, offset=finite)
def test_values_at_boundaries_are_joined_by_lines(grid: Grid, slope: float, offset: float) -> None:
    given_values = [slope * t + offset for t in grid.mesh.boundaries]
    expected = slope * np.array(grid.times) + offset
    np.testing.assert_allclose(initial_state_values(given_values, grid, "x"), expected, atol=1e-9 * (1 + abs(slope)))


@given(grid=grids, data=st.data())
def test_full_arrays_are_taken_as_they_are(grid: Grid, data: st.DataObject) -> None:
    def numbers(length: int) -> list[float]:
        return data.draw(st.lists(finite, min_size=length, max_size=length))

    for guess, length in ((initial_state_values, len(grid.times)), (initial_stage_values, len(grid.points))):
        values = numbers(length)
        assert guess(tuple(values), grid, "x").tolist() == values
    values = numbers(grid.mesh.elements)
    assert element_guess(np.array(values), grid, "x").tolist() == values
    assert initial_stage_values(values, grid, "x").tolist() == [values[grid.element_of[t]] for t in grid.points]


@given(grid=grids, length=st.integers(0, 40))
def test_other_lengths_are_refused_with_both_numbers(grid: Grid, length: int) -> None:
    for guess, lengths in (
        (initial_state_values, {len(grid.times), len(grid.mesh.boundaries)}),
        (initial_stage_values, {len(grid.points), grid.mesh.elements}),
        (element_guess, {grid.mesh.elements}),
    ):
        if length in lengths:
            assert len(guess([0.5] * length, grid, "x")) == max(lengths)
        else:
            needed = " or ".join(map(str, sorted(lengths)))
            with pytest.raises(
                InitialGuessError, match=f"x: the initial guess has {length} values; .* need {needed}. Give {needed}"
            ):
                guess([0.5] * length, grid, "x")


@pytest.mark.parametrize("wrong", [float("nan"), float("inf"), [0, 1, float("nan"), 3], lambda t: -math.inf])
def test_what_is_not_finite_is_refused(wrong) -> None:
    grid = Grid(radau(2), Mesh.uniform(0, 1, 3))
    with pytest.raises(
        InitialGuessError, match=r"x: value [02] of the initial guess is -?(nan|inf); initial guesses must be finite"
    ):
        initial_state_values(wrong, grid, "x")


@pytest.mark.parametrize("wrong", ["1.5", "fast", {0: 1}, [1, [2, 3], 4], lambda t: "a", lambda t: None, 1j, object()])
def test_what_is_no_number_is_refused(wrong) -> None:
    grid = Grid(radau(2), Mesh.uniform(0, 1, 2))
    with pytest.raises(InitialGuessError, match="x: the initial guess is not made of numbers"):
        initial_state_values(wrong, grid, "x")


def test_one_number_is_needed_where_nothing_changes_in_time() -> None:
    with pytest.raises(InitialGuessError, match="has 2 values; one number need 1"):
        initial_number([1, 2], "x")
    with pytest.raises(InitialGuessError, match="is a function of time"):
        initial_number(math.sin, "x")
