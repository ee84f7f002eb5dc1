"""Which equation can determine which unknown: maximum matchings, and the surplus where none is perfect.

Written out rather than taken from a graph library: the structure of a phase is looked at before every solve, and
importing such a library would cost more than all the rest of the look.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from functools import cached_property
from typing import Any


class Matching:
    """A maximum matching of rows with a column each that they hold, and the parts into which it cuts them.

    Of several, that of the rows which come first: a row is left over only where the rows before leave it no column.

    Parameters
    ----------
    rows : iterable of iterable of keys
        What each row holds; what is no column does not count.
    columns : iterable of keys
        Unknowns, in the order in which rows take them.

    Attributes
    ----------
    columns : list of keys
    rows : list of list of keys
        The columns that each row holds, in their order.
    row_of : dict of key to int
        Row matched to each column that has one.

    References
    ----------
    Dulmage & Mendelsohn, Coverings of bipartite graphs, Canad. J. Math. 10 (1958), doi:10.4153/CJM-1958-052-0
    """

    def __init__(self, rows: Iterable[Iterable[Hashable]], columns: Iterable[Hashable]) -> None:
        place = {column: i for i, column in enumerate(dict.fromkeys(columns))}
        self.columns: list[Any] = list(place)
        self.rows: list[list[Any]] = [sorted(place.keys() & row, key=place.__getitem__) for row in rows]
        self.row_of: dict[Any, int] = {}
        self._column_of: dict[int, Any] = {}
        self._dead_ends: tuple[set[int], set[Any]] = set(), set()
        for row in range(len(self.rows)):
            self._augment(row)

    def _augment(self, start: int) -> None:
        """Match one more row by the shortest augmenting path."""
        came_from: dict[Any, int] = {}  # column -> row that reached it
        reached = [start]
        for row in reached:  # it grows
            for column in self.rows[row]:
                if column in came_from:
                    continue
                came_from[column] = row
                if column in self.row_of:
                    reached.append(self.row_of[column])
                    continue
                while column is not None:  # the path back to the start: each row gives its column to the one before
                    row = came_from[column]
                    before = self._column_of.get(row)
                    self._column_of[row], self.row_of[column], column = column, row, before
                return
        # No later path leads through these: all their columns are matched with one of them.
        rows, columns = self._dead_ends
        rows.update(reached)
        columns.update(came_from)

    @property
    def unmatched_rows(self) -> list[int]:
        """Rows without a column of their own."""
        return [row for row in range(len(self.rows)) if row not in self._column_of]

    @property
    def unmatched_columns(self) -> list[Any]:
        """Columns without a row of their own."""
        return [column for column in self.columns if column not in self.row_of]

    @property
    def overdetermined(self) -> tuple[list[int], list[Any]]:
        """Rows and columns of the part that has more rows than columns, whatever the matching; both empty if none."""
        rows, columns = self._dead_ends
        return sorted(rows), [column for column in self.columns if column in columns]

    @cached_property
    def underdetermined(self) -> tuple[list[int], list[Any]]:
        """Rows and columns of the part that has more columns than rows, whatever the matching; both empty if none."""
        rows_with: dict[Any, list[int]] = {column: [] for column in self.columns}
        for row, held in enumerate(self.rows):
            for column in held:
                rows_with[column].append(row)
        columns, rows = Matching(rows_with.values(), range(len(self.rows))).overdetermined
        return rows, [self.columns[column] for column in columns]
