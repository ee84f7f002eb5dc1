"""What holds at a point without a stage, and which algebraics and derivatives have a value there.

Where the scheme has no stage, states have a value of their own and nothing else. The rows that stand there can
determine more: an algebraic from its equation, ``du/dx`` at ``t = 0`` from the rows along space. Which of them hold is
read from two maximum matchings of rows and unknowns at that point.

1. With the states at a first point among the unknowns, conditions on the initial state first: a row that would be one
   too many does not hold, such as a boundary condition at a corner where the initial state is given.
2. With the states known: a row holds when it belongs to a part with as many rows as unknowns. Rows that leave
   derivatives along another set undetermined do not hold. Of the others
   `shown_values` decides: they hold with the values that controls show, or at the first point as in the user's model,
   which may fix there what it likes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from itertools import chain
from typing import Any

from pyrobocop_pyomo.numerics.matching import Matching, maximum_matching

# What becomes of a row at a point without a stage.
HOLDS, UNDECIDED, SURPLUS = "holds", "leaves a variable to choose", "is one too many"


def rows_that_hold(
    pending: Sequence[tuple[Any, list[Any]]],
    conditions: Iterable[list[Any]],
    candidates: Collection[int],
) -> list[str]:
    """Decide on rows at points without a stage.

    Parameters
    ----------
    pending : sequence of (row, variables)
        The rows, each with the variables that it may determine. The first of those that cannot all hold are kept.
    conditions : iterable of list of variables
        The variables, not fixed, of rows that hold in any case.
    candidates : collection of int
        Ids of the variables in question; all others are states, or known for another reason.

    Returns
    -------
    list of str
        `HOLDS`, `UNDECIDED` or `SURPLUS` for each pending row.
    """
    own = [[id(variable) for variable in variables] for _, variables in pending]
    first = [[id(variable) for variable in variables] for variables in conditions]
    with_states = _matched([*first, *own])
    possible = [i for i in range(len(own)) if with_states.column_of[len(first) + i] >= 0]
    unknown = [[key for key in own[i] if key in candidates] for i in possible]
    with_known_states = _matched(unknown)
    short = set(with_known_states.underdetermined[0])
    decisions = [SURPLUS] * len(own)
    for position, i in enumerate(possible):
        decisions[i] = UNDECIDED if position in short else HOLDS
    return decisions


def columns_that_rows_give(rows: Sequence[Sequence[int]], order: Iterable[int]) -> set[int]:
    """As many unknowns as the rows can give, those that come first in an order before others."""
    rows_with: dict[int, list[int]] = {key: [] for key in order}
    for i, row in enumerate(rows):
        for key in row:
            if key in rows_with:
                rows_with[key].append(i)
    matching = maximum_matching(list(rows_with.values()), len(rows), first_come=True)
    return {key for key, row in zip(rows_with, matching.column_of, strict=True) if row >= 0}


def undecided_parts(rows: Sequence[tuple[Any, list[Any]]], absent: Collection[int]) -> list[tuple[list[Any], set[int]]]:
    """The parts of rows that leave variables to choose, each with the ids of its variables.

    Parameters
    ----------
    rows : sequence of (row, variables)
    absent : collection of int
        Ids of the variables without a value of their own.
    """
    known = set(absent)
    part_of: dict[int, tuple[list[int], set[int]]] = {}  # by the id of a variable
    for i, (_, variables) in enumerate(rows):
        own = {id(variable) for variable in variables} & known
        joined = {id(part_of[key]): part_of[key] for key in own if key in part_of}.values()
        part = [*chain.from_iterable(places for places, _ in joined), i], own.union(*(ids for _, ids in joined))
        part_of.update(dict.fromkeys(part[1], part))
    parts = {min(part[0]): part for part in part_of.values()}
    return [([rows[i][0] for i in sorted(parts[first][0])], parts[first][1]) for first in sorted(parts)]


def _matched(rows: Sequence[Sequence[int]]) -> Matching:
    """The matching that prefers the rows before; unknowns are given by their ids."""
    column: dict[int, int] = {}
    incidence = [[column.setdefault(key, len(column)) for key in row] for row in rows]
    return maximum_matching(incidence, len(column), first_come=True)
