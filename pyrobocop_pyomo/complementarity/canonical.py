"""The canonical form of a statement: pairs of nonnegative expressions, and rows beside them."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from enum import Enum
from typing import Any

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
