"""Scales follow a change of units exactly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pyrobocop_pyomo.numerics.characteristic_scales import (
    GroupedEntries,
    objective_scale,
    row_scales,
    sizes_of_groups,
    variable_scales,
)

UNITS = st.floats(1e-4, 1e4)


def double_integrator(rows: int = 4, units: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> GroupedEntries:
    """Rows ``x' - x - h v`` and ``v' - v - h u`` with their entries, in units of length, speed and acceleration."""
    h = 1.0 / rows
    entries = []
    for row in range(rows):
        entries += [(row, row, 1.0, 0, 0), (row, rows + row, h, 0, 1)]
        entries += [(rows + row, rows + row, 1.0, 1, 1), (rows + row, 2 * rows + row, h, 1, 2)]
    numbers, columns, values, of_row, of_column = (np.array(part) for part in zip(*entries, strict=True))
    sizes = np.array(units)
    values = values * sizes[of_row] / sizes[of_column]
    groups = np.repeat(np.arange(3), rows)
    return GroupedEntries(numbers, columns, values[None, :], groups[: 2 * rows], groups, np.array([0, 1]))


def test_what_is_not_known_is_what_moves_the_known_over_the_horizon() -> None:
    for rows in (2, 50):
        assert variable_scales(np.array([8.0, np.nan, np.nan]), double_integrator(rows)) == pytest.approx([8, 8, 8])


@given(st.tuples(UNITS, UNITS, UNITS), UNITS)
def test_scales_follow_units(units: tuple[float, float, float], size: float) -> None:
    before, after = double_integrator(), double_integrator(units=units)
    first = variable_scales(np.array([size, np.nan, np.nan]), before)
    second = variable_scales(np.array([size * units[0], np.nan, np.nan]), after)
    assert second == pytest.approx(first * np.array(units))
    nothing = np.zeros(8)
    assert row_scales(second, after, nothing) == pytest.approx(row_scales(first, before, nothing) * units[:2])


@given(arrays.arrays(float, (2, 3), elements=st.floats(-10, 10)), arrays.arrays(float, 3, elements=UNITS), UNITS)
def test_the_scale_of_an_objective_follows_units(gradients: np.ndarray, units: np.ndarray, unit: float) -> None:
    scales = np.array([1.0, 2.0, 3.0])
    before = objective_scale(gradients, scales)
    if np.abs(gradients).max() > 1e-6:
        assert objective_scale(unit * gradients / units, scales * units) == pytest.approx(unit * before)


@given(UNITS, UNITS, UNITS)
def test_the_size_of_a_group_follows_units(guess: float, width: float, unit: float) -> None:
    assert sizes_of_groups(unit * guess, unit * width) == pytest.approx(unit * sizes_of_groups(guess, width))
    assert sizes_of_groups(guess, np.inf) == pytest.approx(guess)
    assert sizes_of_groups(0.0, width) == pytest.approx(width)


def test_where_nothing_is_known_nothing_is_scaled() -> None:
    assert np.isnan(sizes_of_groups(0.0, np.inf))
    entries = double_integrator()
    assert np.isnan(variable_scales(np.full(3, np.nan), entries)).all()
    assert objective_scale(np.zeros((2, 3)), np.ones(3)) == 1.0


def test_a_singular_row_does_not_decide() -> None:
    values = np.array([[1.0, 2.0, 1e12, 3.0, np.nan]])
    zeros = np.zeros(5, dtype=np.intp)
    entries = GroupedEntries(np.arange(5), zeros, values, zeros, zeros[:1], np.array([-1]))
    assert 1.0 <= row_scales(np.ones(1), entries, np.zeros(5))[0] <= 3.0


def test_a_row_without_a_derivative_has_the_size_of_its_right_hand_side() -> None:
    zeros = np.zeros(1, dtype=np.intp)
    entries = GroupedEntries(zeros, zeros, np.zeros((1, 1)), zeros, zeros, np.array([-1]))
    assert row_scales(np.ones(1), entries, np.array([250.0])) == pytest.approx([250.0])
