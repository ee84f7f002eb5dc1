"""`complements` and `either_zero`, which write one pair as a rule returns it."""

from __future__ import annotations

from typing import Any, NamedTuple

# The choice of a bound that marks the second side of `either_zero`.
ANY_SIGN = "any sign"


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
        these bounds do not take part, and the other side is a range or an equality.

    Returns
    -------
    Complements
        What a `Complementarity` rule returns.
    """
    return Complements(first, second, first_bound, second_bound)


def either_zero(first: Any, second: Any, *, first_bound: str | None = None) -> Complements:
    """State that a side with a sign and a side of any sign are not both away from zero: ``a >= 0`` and ``a h = 0``.

    As `complements`, but the second side may be positive, zero or negative where the first one is zero: a contact
    force acts only while the distance does not change, ``either_zero(force >= 0, speed)``. What stands in the model are
    three pairs of the parts of h: ``a ⟂ max(h, 0)``, ``a ⟂ max(-h, 0)`` and ``max(h, 0) ⟂ max(-h, 0)``.

    Parameters
    ----------
    first : relational expression or variable
        With one finite bound, as in `complements`.
    second : variable or expression
        Its own bounds do not take part in the pair.
    first_bound : {None, "lower", "upper"}
        Which bound is meant of a first side that is a plain variable with two.

    Returns
    -------
    Complements
        What a `Complementarity` rule returns.

    References
    ----------
    Mehlitz (2020), Stationarity conditions and constraint qualifications for mathematical programs with switching
    constraints, Math. Program. 181, doi:10.1007/s10107-019-01380-5
    """
    return Complements(first, second, first_bound, ANY_SIGN)
