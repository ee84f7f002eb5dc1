"""Rounded choices stay near the relaxed ones in what is accumulated, as far as the theorems say."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.numerics.integer_approximation import integral_gap, limited_approximation, sum_up_rounding


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
