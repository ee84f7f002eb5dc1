"""`complements`, which writes one pair as a rule returns it."""

from __future__ import annotations

from typing import Any, NamedTuple


class Complements(NamedTuple):
    """Two sides as the user wrote them, and which bound is meant where a side is a plain variable."""

    first: Any
    second: Any
    first_bound: str | None = None
    second_bound: str | None = None


def complements(
    first: Any, second: Any, *, first_bound: str | None = None, second_bound: str | None = None
) -> Complements:
    """State that both sides hold and that at least one of them holds with equality.

    Parameters
    ----------
    first, second : relational expression or variable
        ``expr >= c`` or ``expr <= c``, where ``c`` may hold parameters; ``lhs >= rhs`` with variables on both
        sides means ``lhs - rhs >= 0``. A plain variable stands for its own finite bound.
    first_bound, second_bound : {None, "lower", "upper"}
        Which bound of a plain variable is meant; needed only where it has two finite ones.

    Returns
    -------
    Complements
        What a `Complementarity` rule returns.
    """
    return Complements(first, second, first_bound, second_bound)
