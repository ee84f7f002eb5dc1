"""What a rule may answer at one point: one row, or several in a list, a tuple or a dict."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any

from pyomo.core.expr.relational_expr import RelationalExpression


def labelled_rows(kind: str, answer: Any) -> dict[Hashable, Any]:
    """The rows of an answer by label; the label is None where there is just one.

    Parameters
    ----------
    kind : {"residual", "constraint", "complementarity"}
        What the rule states. It decides what a tuple is: one pair in a complementarity, Pyomo's
        ``(lower, body, upper)`` in a constraint unless relations stand in it, and otherwise several rows.
    answer : object
        What the rule returned.
    """
    if isinstance(answer, Mapping):
        return dict(answer)
    if isinstance(answer, list) or (isinstance(answer, tuple) and not _is_one_row(kind, answer)):
        return dict(enumerate(answer))
    return {None: answer}


def _is_one_row(kind: str, answer: tuple[Any, ...]) -> bool:
    if kind == "constraint":
        return not any(isinstance(each, (RelationalExpression, tuple)) for each in answer)
    return kind == "complementarity"
