"""What holds at a point without a stage, and which algebraics and derivatives have a value there.

Where the scheme has no stage, states have a value of their own and nothing else. The rows that stand there can
determine more: an algebraic from its equation, ``du/dx`` at ``t = 0`` from the rows along space. Which of them hold is
read from two maximum matchings of rows and unknowns at that point.

1. With the states at a first point among the unknowns, conditions on the initial state first: a row that would be one
   too many does not hold, such as a boundary condition at a corner where the initial state is given.
2. With the states known: a row holds when it belongs to a part with as many rows as unknowns. A row that a control
   leaves undetermined does not hold, nor do rows that leave derivatives along space undetermined, unless something else
   in the model holds these.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

from pyrobocop_pyomo.numerics.matching import Matching, maximum_matching


def rows_that_hold(
    pending: Sequence[tuple[Any, list[Any]]],
    conditions: Iterable[list[Any]],
    candidates: Collection[int],
    along_space: set[int],
    needed: set[int],
) -> list[bool]:
    """Decide on rows at points without a stage.

    Parameters
    ----------
    pending : sequence of (row, variables)
        The rows, each with the variables that it may determine. The first of those that cannot all hold are kept.
    conditions : iterable of list of variables
        The variables, not fixed, of rows that hold in any case.
    candidates : collection of int
        Ids of the variables in question; all others are states, or known for another reason.
    along_space : set of int
        Ids of the candidates that are derivatives along another set.
    needed : set of int
        Ids of those among them that something else in the model holds.

    Returns
    -------
    list of bool
        For each pending row, whether it holds.
    """
    own = [[id(variable) for variable in variables] for _, variables in pending]
    first = [[id(variable) for variable in variables] for variables in conditions]
    with_states = _matched([*first, *own])
    possible = [i for i in range(len(own)) if with_states.column_of[len(first) + i] >= 0]
    unknown = [[key for key in own[i] if key in candidates] for i in possible]
    with_known_states = _matched(unknown)
    short = set(with_known_states.underdetermined[0])
    short -= _connected(unknown, short, along_space, needed)
    holding = {i for position, i in enumerate(possible) if position not in short}
    return [i in holding for i in range(len(own))]


def _matched(rows: Sequence[Sequence[int]]) -> Matching:
    """The matching that prefers the rows before; unknowns are given by their ids."""
    column: dict[int, int] = {}
    incidence = [[column.setdefault(key, len(column)) for key in row] for row in rows]
    return maximum_matching(incidence, len(column), first_come=True)


def _connected(rows: Sequence[Sequence[int]], among: set[int], through: set[int], start: set[int]) -> set[int]:
    """The rows that unknowns lead to, from row to row through some unknowns only."""
    rows_with: dict[int, list[int]] = {}
    for i in among:
        for key in rows[i]:
            rows_with.setdefault(key, []).append(i)
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
