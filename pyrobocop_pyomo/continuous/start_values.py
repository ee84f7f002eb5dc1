"""What holds at the initial time of a model with several sets, and which derivatives along space have a value there.

At the first point of a set, where the scheme has no stage, states have a value and nothing else. A derivative of a
state along another set, ``du/dx`` at ``t = 0``, can have one as well: the rows that discretise it hold states alone.
It is needed where a boundary condition holds it, ``du/dx = g(t)``, since the state at the boundary follows from it.
Which of these rows hold is read from a maximum matching of rows and unknowns at that point. Conditions on the initial
state come first. A row that would be one too many does not hold, such as a boundary condition at a corner where the
initial state is given, nor do rows that leave derivatives undetermined, unless something else in the model holds these.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pyrobocop_pyomo.numerics.matching import maximum_matching


def rows_that_hold(
    pending: list[tuple[Any, list[Any]]], conditions: Iterable[list[Any]], needed: set[int], candidates: set[int]
) -> list[bool]:
    """Decide on rows with derivatives along other sets at the first point of a set.

    Parameters
    ----------
    pending : list of (row, variables)
        The rows, each with its variables that are not fixed. The first of those that cannot all hold are kept.
    conditions : iterable of list of variables
        The variables, not fixed, of rows that hold in any case.
    needed : set of int
        Ids of the variables that something else in the model holds.
    candidates : set of int
        Ids of the derivatives in question.

    Returns
    -------
    list of bool
        For each pending row, whether it holds.
    """
    column: dict[int, int] = {}
    rows = [
        [column.setdefault(id(variable), len(column)) for variable in variables]
        for variables in (*conditions, *(variables for _, variables in pending))
    ]
    first, own = rows[: len(rows) - len(pending)], rows[len(rows) - len(pending) :]
    matching = maximum_matching(rows, len(column), first_come=True)
    offset = len(first)
    in_question = _columns(candidates, column)
    short = {
        row - offset for row in matching.underdetermined[0] if row >= offset and not in_question.isdisjoint(rows[row])
    }
    short -= _connected(own, short, in_question, _columns(needed, column))
    return [matching.column_of[offset + i] >= 0 and i not in short for i in range(len(pending))]


def _columns(ids: set[int], column: dict[int, int]) -> set[int]:
    return {column[key] for key in ids if key in column}


def _connected(rows: list[list[int]], among: set[int], through: set[int], start: set[int]) -> set[int]:
    """The rows that columns lead to, from row to row through some columns only."""
    rows_with: dict[int, list[int]] = {}
    for i in among:
        for column in rows[i]:
            rows_with.setdefault(column, []).append(i)
    reached: set[int] = set()
    seen = start & through
    waiting = list(seen)
    while waiting:
        for i in rows_with.get(waiting.pop(), ()):
            if i in reached:
                continue
            reached.add(i)
            fresh = (set(rows[i]) & through) - seen
            seen |= fresh
            waiting += fresh
    return reached
