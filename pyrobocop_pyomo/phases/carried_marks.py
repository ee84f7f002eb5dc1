"""What a user has set on single variables over time, such as other bounds, carried over to another mesh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pyrobocop_pyomo.errors import ModelError

from .nodes import Nodes, StateNodes


def carried_marks(
    marks: list[Any], usual: list[Any], before: Nodes, nodes: Nodes, vanished: Sequence[int], label: str
) -> list[int | None]:
    """For each new node, an old one whose mark it takes over; None where it has the usual one.

    A new node has the mark of the old element that it lies in, where all of that has the same. The ends of a state are
    another matter: they have initial and final values.

    Parameters
    ----------
    marks, usual : list
        Of each old node: what is there, and what the declaration says.
    before : Nodes
        The old ones.
    nodes : Nodes
        The new ones.
    vanished : sequence of int
        Old nodes that the new mesh has not.
    label : str
        What the marks are, for the message.

    Raises
    ------
    ModelError
        When what was set on a single node would be lost.
    """
    marks = list(marks)
    if isinstance(before, StateNodes):
        marks[0], marks[-1] = usual[0], usual[-1]
        inner = set(marks[1:-1])
        if len(inner) == 1 and len(marks) > 3:  # set for the whole phase, and not at a waypoint
            marks[0] = marks[-1] = inner.pop()
    if marks == usual:
        return [None] * len(nodes.times)
    set_by_user = {
        i for i, (mark, by_declaration) in enumerate(zip(marks, usual, strict=True)) if mark != by_declaration
    }
    for i in vanished:
        around = before.around(before.times[i])
        if i in set_by_user and any(marks[j] != marks[i] for j in around):
            raise ModelError(
                f"{label} at t = {before.times[i]:g} was set for this time alone, which the new mesh has not. "
                "Set it for the whole element, or make the time an element boundary of the new mesh."
            )
    found: list[int | None] = []
    for time in nodes.times:
        around = before.around(time)
        same = set(around) <= set_by_user and len({marks[j] for j in around}) == 1
        found.append(around[0] if same else None)
    return found
