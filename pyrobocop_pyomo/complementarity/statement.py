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
    """State that two sides are complementary: two finite bounds, one per side or both on one.

    Of ``a >= 0`` and ``b >= 0`` both hold, and at least one with equality. Of a range ``l <= F <= u`` and a free
    side ``H`` the range holds, with F at l where H is positive and at u where H is negative. An equality
    ``F == c`` holds whatever the free side does.

    Parameters
    ----------
    first, second : relational expression, variable or expression
        ``expr >= c`` or ``expr <= c``, where ``c`` may hold parameters; ``lhs >= rhs`` with variables on both
        sides means ``lhs - rhs >= 0``; a range ``inequality(l, expr, u)``, of which an infinite bound counts as
        none; an equality. A plain variable stands for its own finite bounds. A bare expression, or a variable
        without bounds, is a free side. Against a range one side may be ``expr >= 0`` or ``expr <= 0`` as well:
        the other bound of the range is then a constraint of its own.
    first_bound, second_bound : {None, "lower", "upper", "free"}
        Which bound of a plain variable is meant; needed only where it has two finite ones. "free": none of them,
        they are just bounds, and the other side is a range or an equality.

    Returns
    -------
    Complements
        What a `Complementarity` rule returns.
    """
    return Complements(first, second, first_bound, second_bound)
