"""Matchings and their leftover parts, against SciPy, and against what the parts are by definition."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import structural_rank

from pyrobocop_pyomo.numerics import Matching

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
