"""Scales follow a change of units exactly."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import structural_rank

from pyrobocop_pyomo.numerics import Matching
from pyrobocop_pyomo.numerics.characteristic_scales import (
    GroupedEntries,
    objective_scale,
    row_scales,
    sizes_of_groups,
    variable_scales,
)
from pyrobocop_pyomo.numerics.integer_approximation import integral_gap, limited_approximation, sum_up_rounding

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


# --------------------------------------------------------------------
# Matchings and their leftover parts, against SciPy, and against what the parts are by definition.


patterns = st.integers(1, 8).flatmap(
    lambda columns: st.lists(
        st.lists(st.integers(0, columns - 1), unique=True).map(sorted), min_size=1, max_size=9
    ).map(lambda rows: (rows, columns))
)


def rank(rows: list[list[int]], columns: int) -> int:
    dense = np.zeros((len(rows), columns))
    for i, held in enumerate(rows):
        dense[i, held] = 1
    return int(structural_rank(csr_matrix(dense)))


@given(patterns)
def test_a_matching_is_one_and_is_as_large_as_the_structural_rank(pattern: tuple[list[list[int]], int]) -> None:
    rows, columns = pattern
    matching = Matching(rows, range(columns))
    pairs = matching.row_of.items()
    assert all(column in rows[row] for column, row in pairs)
    assert len({row for _, row in pairs}) == rank(rows, columns) == columns - len(matching.unmatched_columns)
    assert len(matching.unmatched_rows) == len(rows) - len(pairs)


@given(patterns)
@settings(max_examples=40)
def test_a_row_is_overdetermined_exactly_when_the_rank_survives_without_it(
    pattern: tuple[list[list[int]], int],
) -> None:
    rows, columns = pattern
    expected = [i for i in range(len(rows)) if rank([*rows[:i], [], *rows[i + 1 :]], columns) == rank(rows, columns)]
    over, shared = Matching(rows, range(columns)).overdetermined
    assert over == expected
    assert shared == sorted({column for row in over for column in rows[row]})


@given(patterns)
def test_the_underdetermined_part_is_the_overdetermined_one_of_the_transpose(
    pattern: tuple[list[list[int]], int],
) -> None:
    rows, columns = pattern
    transposed = [[i for i, held in enumerate(rows) if column in held] for column in range(columns)]
    under_rows, under_columns = Matching(rows, range(columns)).underdetermined
    assert (under_columns, under_rows) == Matching(transposed, range(len(rows))).overdetermined


def test_a_long_chain_is_augmented_through() -> None:
    """Each row could have its neighbour's column, the last one has none left: the chain shifts as a whole."""
    n = 20_000
    rows = [*([i, i + 1] for i in range(n)), [0]]
    assert Matching(rows, range(n + 1)).unmatched_rows == []


# --------------------------------------------------------------------
# Rounded choices stay near the relaxed ones in what is accumulated, as far as the theorems say.


@st.composite
def relaxed_choices(draw: Any) -> tuple[Any, Any]:
    alternatives, intervals = draw(st.integers(2, 4)), draw(st.integers(1, 12))
    random = np.random.default_rng(draw(st.integers(0, 10_000)))
    weights = random.random((alternatives, intervals)) ** draw(st.sampled_from([0.2, 1.0, 5.0]))
    return weights / weights.sum(axis=0), random.uniform(0.1, 2.0, intervals)


@given(relaxed_choices())
def test_the_gap_of_sum_up_rounding_is_within_its_bound(case: tuple[Any, Any]) -> None:
    weights, widths = case
    found = sum_up_rounding(weights, widths)
    assert found.bound is not None
    assert found.gap <= found.bound + 1e-12
    assert found.gap == pytest.approx(integral_gap(weights, found.choice, widths))


@given(relaxed_choices())
def test_what_is_a_choice_already_stays(case: tuple[Any, Any]) -> None:
    weights, widths = case
    choice = weights.argmax(axis=0)
    binary = (choice == np.arange(len(weights))[:, None]).astype(float)
    found = sum_up_rounding(binary, widths)
    assert found.choice.tolist() == choice.tolist()
    assert found.gap == pytest.approx(0.0, abs=1e-12)


@given(relaxed_choices(), st.integers(0, 3), st.floats(0.0, 3.0))
@settings(max_examples=15, deadline=None)
def test_limits_are_kept_and_the_gap_is_no_larger_without_them(
    case: tuple[Any, Any], switches: int, dwell: float
) -> None:
    weights, widths = case
    free = limited_approximation(weights, widths)
    limited = limited_approximation(weights, widths, max_switches=switches, min_dwell=dwell)
    assert free is not None
    assert limited is not None
    assert free.gap <= sum_up_rounding(weights, widths).gap + 1e-5 * widths.mean()
    assert free.gap <= limited.gap + 1e-5 * widths.mean()
    assert limited.switches <= switches
    ends = np.flatnonzero(np.diff(limited.choice)) + 1
    for first, last in pairwise(ends):
        assert widths[first:last].sum() >= dwell - 1e-6
