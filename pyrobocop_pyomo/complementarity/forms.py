"""From two sides to the canonical form of a statement.

Two finite bounds make a statement, as in Pyomo's own `pyomo.mpec`: one per side, or both on one side, while the other
side is free. More or fewer bounds are refused.

The canonical form of a statement: pairs of nonnegative expressions, and rows beside them.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from enum import Enum
from typing import Any

from pyomo.core.expr import EqualityExpression
from pyomo.core.expr.numvalue import native_numeric_types, value

from pyrobocop_pyomo.errors import ComplementarityError

from .sides import ParsedSide, above_lower, below_upper, check_sides, four_bounds_error, read_side
from .statement import ANY_SIGN

# --------------------------------------------------------------------------------------------------- the canonical form


# What tells pairs of one statement apart: of a range by its bounds, of a side of any sign by its parts.
PAIR_ROLES = ("lower", "upper", "positive", "negative", "sign")


class SidePart(Enum):
    """Which part of the expression ``b`` is complementary to ``a``."""

    WHOLE = "b itself, which is nonnegative"
    POSITIVE = "max(b, 0)"
    NEGATIVE = "max(-b, 0)"


@dataclass(frozen=True, eq=False, slots=True)
class CanonicalPair:
    """One pair as ``0 <= a ⟂ b >= 0``.

    Attributes
    ----------
    source : component data
        The pair as declared, of this package or of `pyomo.mpec`; never changed but for its activity.
    a, b : Pyomo expression
        Nonnegative where the sides hold; a bare variable where its bound is zero.
    a_row, b_row : relational expression or None
        The constraint that keeps the side nonnegative; None where a variable's own bound does it.
    b_part : SidePart
        Which part of ``b`` belongs to the pair. Of a range ``l <= F <= u ⟂ H``, the first pair couples F - l with the
        positive part of H, the second u - F with the negative one. ``b`` is H in both, of any sign.
    role : {"", "lower", "upper", "positive", "negative", "sign"}
        Tells pairs of one source apart.
    a_part : SidePart
        Which part of ``a`` belongs to the pair. Not all of it only where both sides are parts of one expression.
    """

    source: Any
    a: Any
    b: Any
    a_row: Any
    b_row: Any
    b_part: SidePart = SidePart.WHOLE
    role: str = ""
    a_part: SidePart = SidePart.WHOLE

    @property
    def group(self) -> Hashable | None:
        """Label of the group that the pair belongs to, as it was declared."""
        return getattr(self.source, "group", None)

    @property
    def weight(self) -> Any:
        """Measure of the pair in a penalty, as it was declared: a number or an expression of parameters."""
        return getattr(self.source, "weight", 1)

    @property
    def name(self) -> str:
        """Name of the pair, as the user finds it in the model; where one statement gives two, with the role."""
        # Asked for when needed: a full name costs about as much as the rest of the canonical form.
        return f"{self.source.name} ({self.role})" if self.role else self.source.name


@dataclass(frozen=True, eq=False, slots=True)
class CanonicalForm:
    """The pairs and rows of one statement.

    Attributes
    ----------
    source : component data
        The statement as declared.
    pairs : tuple of CanonicalPair
        One; two for a range against a free side; three for a side against one of any sign; none for an equality
        against a free side.
    rows : tuple of relational expressions
        Constraints beyond the ``a_row`` and ``b_row`` of the pairs.
    between : tuple (l, F, u) or None
        The range itself where it stands against a free side, so that the two pairs are read as one choice of three.
    """

    source: Any
    pairs: tuple[CanonicalPair, ...]
    rows: tuple[Any, ...] = ()
    between: tuple[Any, Any, Any] | None = None


# ---------------------------------------------------------------------------------------------------------------- forms


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
        pair = CanonicalPair(source, *_columns(_only(a), _only(b)))
        return CanonicalForm(source, (pair,))
    bounded, other = (b, a) if second.__class__ is EqualityExpression or a.bounds < b.bounds else (a, b)
    if bounded.given.__class__ is EqualityExpression:
        return CanonicalForm(source, (), (bounded.given,))
    if bounded.bounds < 2:
        # Of two sides without bounds the plain variable is the one that a bound can be given to.
        raise _too_few(other if bounded.bounds or (b.is_variable and not a.is_variable) else a, source)
    if other.bounds == 2:
        raise four_bounds_error(a.given, b.given, source)
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
