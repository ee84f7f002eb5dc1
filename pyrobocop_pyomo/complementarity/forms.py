"""From two sides to the canonical form of a statement.

Two finite bounds make a statement, as in Pyomo's own `pyomo.mpec`: one per side, or both on one side, while the other
side is free. More or fewer bounds are refused.
"""

from __future__ import annotations

from typing import Any

from pyomo.core.expr import EqualityExpression
from pyomo.core.expr.numvalue import native_numeric_types, value

from pyrobocop_pyomo.errors import ComplementarityError

from .canonical import CanonicalForm, CanonicalPair, SidePart
from .sides import ParsedSide, above_lower, below_upper, check_sides, four_bounds, read_side
from .statement import ANY_SIGN


def form_of(
    source: Any,
    first: Any,
    second: Any,
    choices: tuple[str | None, str | None] = (None, None),
) -> CanonicalForm:
    """Bring two sides into canonical form.

    Parameters
    ----------
    source : component data
        The statement, which messages name.
    first, second : relational expression, variable or expression
        The sides as the user wrote them.
    choices : pair of {None, "lower", "upper", "free"}
        Which bound of a plain variable is meant.

    Raises
    ------
    ComplementarityError
        If the sides do not have two finite bounds together, or bounds that nothing can meet.
    """
    check_sides(first, second, choices, source)
    a, b = read_side(first, choices[0], source), read_side(second, choices[1], source)
    if choices[1] == ANY_SIGN:
        return _any_sign(a, b, source)
    if a.bounds == b.bounds == 1:
        _refuse_contradiction(a, b, source)
        pair = CanonicalPair(source, *_columns(_only(a), _only(b)))
        return CanonicalForm(source, (pair,))
    bounded, other = (b, a) if second.__class__ is EqualityExpression or a.bounds < b.bounds else (a, b)
    if bounded.given.__class__ is EqualityExpression:
        return CanonicalForm(source, (), (bounded.given,))
    if bounded.bounds < 2:
        # Of two sides without bounds the plain variable is the one that a bound can be given to.
        raise _too_few(other if bounded.bounds or (b.is_variable and not a.is_variable) else a, source)
    if other.bounds == 2:
        raise four_bounds(a.given, b.given, source)
    _refuse_crossed(bounded, source)
    if other.bounds == 1:
        return _implied_side(bounded, other, source)
    return _range(bounded, other.body, source)


def _range(side: ParsedSide, free: Any, source: Any) -> CanonicalForm:
    """``l <= F <= u ⟂ H``: F is at l where H > 0 and at u where H < 0."""
    if all(bound.__class__ in native_numeric_types for bound in (side.lower, side.upper)) and side.lower == side.upper:
        # Not for parameters, which may move apart.
        return CanonicalForm(source, (), (side.body == side.lower,))
    lower, lower_row = above_lower(side)
    upper, upper_row = below_upper(side)
    return CanonicalForm(
        source,
        (
            CanonicalPair(source, lower, free, lower_row, None, SidePart.POSITIVE, "lower"),
            CanonicalPair(source, upper, free, upper_row, None, SidePart.NEGATIVE, "upper"),
        ),
        between=(side.lower, side.body, side.upper),
    )


def _any_sign(side: ParsedSide, free: ParsedSide, source: Any) -> CanonicalForm:
    """``F >= l`` and ``(F - l) H = 0``, with both parts of H: only where one of these is zero are they its parts."""
    if side.bounds == 0:
        raise _too_few(side, source)
    if side.bounds == 2:
        raise ComplementarityError(
            f"'{source.name}': side '{side.given}' has two finite bounds; of either_zero(first, second) the first side "
            "has one. Write 'expr >= c', or choose with first_bound= 'lower' or 'upper'."
        )
    a, row = _only(side)
    h, positive, negative = free.body, SidePart.POSITIVE, SidePart.NEGATIVE
    return CanonicalForm(
        source,
        (
            CanonicalPair(source, a, h, row, None, positive, "positive"),
            CanonicalPair(source, a, h, row, None, negative, "negative"),
            CanonicalPair(source, h, h, None, None, negative, "sign", positive),
        ),
    )


def _implied_side(side: ParsedSide, signed: ParsedSide, source: Any) -> CanonicalForm:
    """``l <= F <= u ⟂ H >= 0``: the sign of H says that only the lower bound can be the one that is met."""
    if side.is_variable:
        raise ComplementarityError(
            f"'{source.name}': side '{side.given}' has two finite bounds, {value(side.lower):g} and "
            f"{value(side.upper):g}; one is meant. Write '{side.given} >= {value(side.lower):g}' or "
            f"'{side.given} <= {value(side.upper):g}', or pass complements(..., first_bound=) or "
            "(..., second_bound=) 'lower' or 'upper'."
        )
    bound = signed.lower if signed.lower is not None else signed.upper
    if bound.__class__ not in native_numeric_types or bound != 0:
        raise ComplementarityError(
            f"'{source.name}': sides '{side.given}' and '{signed.given}' (bound {bound}) have three finite bounds, "
            "where two are needed. Against a range the other side is free, or >= 0 or <= 0: make its bound a "
            "Constraint, or pass first_bound= or second_bound='free' where it is a plain variable."
        )
    if signed.lower is not None:
        met, far = above_lower(side), below_upper(side)
    else:
        met, far = below_upper(side), above_lower(side)
    pair = CanonicalPair(source, *_columns(met, _only(signed)))
    return CanonicalForm(source, (pair,), () if far[1] is None else (far[1],))


def _only(side: ParsedSide) -> tuple[Any, Any]:
    return above_lower(side) if side.lower is not None else below_upper(side)


def _columns(a: tuple[Any, Any], b: tuple[Any, Any]) -> tuple[Any, Any, Any, Any]:
    return a[0], b[0], a[1], b[1]


def _too_few(side: ParsedSide, source: Any) -> ComplementarityError:
    remedy = (
        f"Set it, for example by {side.given}.setlb(0), or write a relation such as '{side.given} >= 0'."
        if side.is_variable
        else "Write expr >= 0."
    )
    return ComplementarityError(
        f"'{source.name}': side '{side.given}' has no finite bound; a complementary side needs one. {remedy}"
    )


def _refuse_crossed(side: ParsedSide, source: Any) -> None:
    lower, upper = value(side.lower), value(side.upper)
    if lower > upper:
        raise ComplementarityError(
            f"'{source.name}': side '{side.given}' lies between the bounds {lower:g} and {upper:g}, which contradict "
            "each other. Exchange or correct them."
        )


def _refuse_contradiction(a: ParsedSide, b: ParsedSide, source: Any) -> None:
    """Refuse a side that the own constant bounds of its variable make impossible."""
    for side in (a, b):
        if _farthest(side) < 0:
            raise ComplementarityError(
                f"'{source.name}': side '{side.given}' contradicts the bounds of '{side.body}', "
                f"{side.body.lower} and {side.body.upper}. Correct one of them."
            )


def _farthest(side: ParsedSide) -> float:
    """Largest distance to the stated bound that constants leave to a plain variable; 0 if unknown."""
    if side.own is None or side.is_variable:
        return 0
    below = side.lower is not None
    end, bound = side.own[below], side.lower if below else side.upper
    if end.__class__ not in native_numeric_types or bound.__class__ not in native_numeric_types:
        return 0  # there is no end, or a parameter may move
    return end - bound if below else bound - end
