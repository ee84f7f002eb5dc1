"""How objects show themselves: one line for a terminal, the whole text for a notebook. Text only, no model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import Decimal
from html import escape
from typing import Any


def aligned(rows: Sequence[Sequence[str]], sides: Sequence[str]) -> str:
    """Rows of text below each other, each column at its side: "<" or ">"."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    styles = [f"{side}{width}" for side, width in zip(sides, widths, strict=True)]
    return "\n".join("  ".join(map(format, row, styles)).rstrip() for row in rows)


# An object in a list, in a traceback or at the end of a cell must not fill the screen.
MOST_CHARACTERS = 160


class Presented:
    """Base of results and reports: a short `repr`, and the whole text for notebooks.

    Subclasses say in `_summary` what matters most, by default the first line of their text. Notebooks and ``print``
    show the whole text.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        # A dataclass writes a repr of all its fields into every class that has none of its own.
        if "__repr__" not in cls.__dict__:
            cls.__repr__ = Presented.__repr__  # type: ignore[method-assign]

    def _shown_as(self) -> str:
        return type(self).__name__

    def _summary(self) -> str:
        return str(self).partition("\n")[0] if type(self).__str__ is not object.__str__ else ""

    def __repr__(self) -> str:
        return one_line(self._shown_as(), self._summary())

    def _repr_html_(self) -> str:
        return preformatted(str(self))


def one_line(kind: str, summary: str) -> str:
    """``<Kind: summary>``, cut where it would be too long."""
    text = " ".join(f"{kind}: {summary}".split()) if summary else kind
    return f"<{text if len(text) <= MOST_CHARACTERS else text[: MOST_CHARACTERS - 4] + ' ...'}>"


def preformatted(text: str) -> str:
    """HTML that shows a text as a terminal does."""
    return f"<pre>{escape(text)}</pre>"


# Smaller numbers are not worth more digits.
SMALLEST = 1e-9


def percent(share: float) -> str:
    """A share as people write it: "13 %", "0.02 %", "below 1e-7 %"."""
    if not math.isfinite(share):
        return "not known"
    if share <= SMALLEST:
        return "below 1e-7 %"
    value = 100 * share
    return f"{value:.0f} %" if value >= 1 else f"{Decimal(f'{value:.1g}'):f} %"
