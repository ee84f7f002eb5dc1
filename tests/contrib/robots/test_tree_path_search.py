"""Paths by random trees: every line of them is clear, they end where they should, and shortcuts never lengthen them."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.contrib.robots.sampled_path import AreClear, clear_length, shortened, tree_path
from pyrobocop_pyomo.numerics import Array, BoolArray

SPACING = 0.05
BOX = (np.zeros(2), np.ones(2))
START, GOAL = np.array([[0.1, 0.1]]), np.array([[0.9, 0.1]])


def wall_with_a_gap(low: float, high: float, less: float = 0.0) -> AreClear:
    """A wall at x = 0.4 to 0.6 that is open for y between two numbers; thinner by some length on all sides."""

    def are_clear(points: Array) -> BoolArray:
        inside = (points >= 0.0).all(axis=1) & (points <= 1.0).all(axis=1)
        in_wall = (np.abs(points[:, 0] - 0.5) <= 0.1 - less) & ~(
            (points[:, 1] > low - less) & (points[:, 1] < high + less)
        )
        return np.asarray(inside & ~in_wall)

    return are_clear


def length(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


@given(seed=st.integers(0, 10**6), low=st.floats(0.2, 0.7), width=st.floats(0.1, 0.25))
@settings(deadline=None, max_examples=25)
def test_a_path_is_clear_and_a_shortened_one_is_clear_and_no_longer(seed: int, low: float, width: float) -> None:
    are_clear = wall_with_a_gap(low, low + width)
    generator = np.random.default_rng(seed)
    path, used = tree_path(START, GOAL, BOX, are_clear, spacing=SPACING, samples=5000, generator=generator)
    assert path is not None
    assert used <= 5000
    short = shortened(path, are_clear, spacing=SPACING, tries=100, generator=generator)
    for each in (path, short):
        assert np.array_equal(each[[0, -1]], np.vstack([START, GOAL]))
        # Points that are no farther apart than the spacing were looked at: all others are close to one of them.
        thinner = wall_with_a_gap(low, low + width, less=0.5 * SPACING)
        assert all(clear_length(a, b, thinner, 0.01) == 1.0 for a, b in pairwise(each))
    assert np.linalg.norm(START - GOAL) <= length(short) <= length(path) * (1.0 + 1e-12)
    assert (short[:, 1] > low).any()
