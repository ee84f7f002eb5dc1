"""Which equation can determine which unknown: maximum matchings, and what is left over or short where none is perfect.

Written out rather than taken from a graph library: the structure of a phase is looked at before every solve, and
importing such a library would cost more than all the rest of the look.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

Incidence = Sequence[Sequence[int]]


@dataclass(frozen=True)
class Matching:
    """A maximum matching of rows and columns, and the parts into which it cuts them.

    Attributes
    ----------
    incidence : sequence of sequences of int
        The columns that each row holds.
    column_of : tuple of int
        Column matched to each row, -1 where there is none.
    row_of : tuple of int
        Row matched to each column, -1 where there is none.

    References
    ----------
    Dulmage & Mendelsohn, Coverings of bipartite graphs, Canad. J. Math. 10 (1958), doi:10.4153/CJM-1958-052-0
    """

    incidence: Incidence
    column_of: tuple[int, ...]
    row_of: tuple[int, ...]

    @property
    def unmatched_rows(self) -> list[int]:
        """Rows without a column of their own."""
        return [row for row, column in enumerate(self.column_of) if column < 0]

    @property
    def unmatched_columns(self) -> list[int]:
        """Columns without a row of their own."""
        return [column for column, row in enumerate(self.row_of) if row < 0]

    @cached_property
    def overdetermined(self) -> tuple[list[int], list[int]]:
        """Rows and columns of the part that has more rows than columns, whatever the matching; both empty if none."""
        return _reached(self.unmatched_rows, self.incidence, self.row_of)

    @cached_property
    def underdetermined(self) -> tuple[list[int], list[int]]:
        """Rows and columns of the part that has more columns than rows, whatever the matching; both empty if none."""
        rows_with: list[list[int]] = [[] for _ in self.row_of]
        for row, own_columns in enumerate(self.incidence):
            for column in own_columns:
                rows_with[column].append(row)
        columns, rows = _reached(self.unmatched_columns, rows_with, self.column_of)
        return rows, columns


def _reached(unmatched: list[int], incidence: Incidence, partner: Sequence[int]) -> tuple[list[int], list[int]]:
    """What alternating paths from unmatched nodes reach: nodes like these, and the others, each in order."""
    nodes, others = set(unmatched), set[int]()
    waiting = list(unmatched)
    while waiting:
        for other in incidence[waiting.pop()]:
            others.add(other)
            node = partner[other]  # never -1: the matching would not be maximum
            if node not in nodes:
                nodes.add(node)
                waiting.append(node)
    return sorted(nodes), sorted(others)


def maximum_matching(incidence: Incidence, columns: int) -> Matching:
    """Match as many rows as possible with a column each that they hold; of several, those that come first.

    Parameters
    ----------
    incidence : sequence of sequences of int
        The columns that each row holds.
    columns : int
        Number of columns.

    Notes
    -----
    Shortest augmenting paths from one row after the other: a row is left over only where the rows before it leave it
    no column.
    """
    column_of = [-1] * len(incidence)
    row_of = [-1] * columns
    for row in range(len(incidence)):
        _augment(row, incidence, column_of, row_of)
    return Matching(incidence, tuple(column_of), tuple(row_of))


def _augment(start: int, incidence: Incidence, column_of: list[int], row_of: list[int]) -> None:
    came_from: dict[int, int] = {}  # column -> row that reached it
    reached = [start]
    for row in reached:  # it grows
        for column in incidence[row]:
            if column in came_from:
                continue
            came_from[column] = row
            if row_of[column] >= 0:
                reached.append(row_of[column])
                continue
            while column >= 0:  # the path back to the start: each row gives its column to the one before
                row = came_from[column]
                column_of[row], row_of[column], column = column, row, column_of[row]
            return
