"""How objects show themselves: one line for a terminal, a small table for a notebook. Text only, no model.

Tables have no scripts, and no colours of their own, so that they fit any page.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from html import escape
from typing import Any

# A table of more rows says how many it leaves out.
MOST_ROWS = 40
# Pages other than Jupyter's set no distance between columns.
CELL_STYLE = "text-align: left; padding: 0.1em 1.2em 0.1em 0"


class Html(str):
    """Text that is HTML already, and goes into a table as it is; all other text is escaped."""

    __slots__ = ()


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> Html:
    """A table with a header; the first column is text, and so are the cells that are `Html`."""
    listed = list(rows)
    shown = listed[:MOST_ROWS]
    head = "".join(f'<th style="{CELL_STYLE}">{escape(name)}</th>' for name in header)
    body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in shown)
    rest = f"<div>... and {len(listed) - len(shown)} more</div>" if len(listed) > len(shown) else ""
    return Html(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{rest}")


def aligned(rows: Sequence[Sequence[str]], sides: Sequence[str]) -> str:
    """Rows of text below each other, each column at its side: "<" or ">"."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    styles = [f"{side}{width}" for side, width in zip(sides, widths, strict=True)]
    return "\n".join("  ".join(map(format, row, styles)).rstrip() for row in rows)


def facts_table(facts: Mapping[str, object]) -> Html:
    """A table of two columns: what, and its value. What is None is left out."""
    rows = [(Html(f"<strong>{escape(name)}</strong>"), value) for name, value in facts.items() if value is not None]
    return table((), rows)


def paragraph(text: str) -> Html:
    """Text as it is, on lines of its own."""
    return Html(f"<div>{escape(text)}</div>")


def disclosed_text(summary: str, text: str) -> Html:
    """Text as it would be printed, which opens on a click."""
    return Html(f"<details><summary>{escape(summary)}</summary><pre>{escape(text)}</pre></details>")


def _cell(value: object) -> str:
    text = value if isinstance(value, Html) else escape(f"{value:.6g}" if isinstance(value, float) else str(value))
    return f'<td style="{CELL_STYLE}">{text}</td>'


# An object in a list, in a traceback or at the end of a cell must not fill the screen.
MOST_CHARACTERS = 160


class Presented:
    """Base of results and reports: a short `repr`, and HTML for notebooks.

    Subclasses say in `_summary` what matters most, by default the first line of their text, and in `_html_parts` what a
    notebook shows below it, by default the whole text, folded. ``print`` shows the whole text, as ever.
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

    def _html_parts(self) -> list[str]:
        return [disclosed_text("as text", str(self))] if type(self).__str__ is not object.__str__ else []

    def __repr__(self) -> str:
        return one_line(self._shown_as(), self._summary())

    def _repr_html_(self) -> str:
        return as_html(self._shown_as(), self._summary(), self._html_parts())


def one_line(kind: str, summary: str) -> str:
    """``<Kind: summary>``, cut where it would be too long."""
    text = " ".join(f"{kind}: {summary}".split()) if summary else kind
    return f"<{text if len(text) <= MOST_CHARACTERS else text[: MOST_CHARACTERS - 4] + ' ...'}>"


def as_html(kind: str, summary: str, parts: Iterable[str]) -> Html:
    """The same in bold, and below it what was made by the other functions here."""
    title = f"{kind}: {summary}" if summary else kind
    return Html(f"<div><div><strong>{escape(title)}</strong></div>{''.join(parts)}</div>")


# What is smaller is not worth more digits.
SMALLEST = 1e-9


def percent(share: float) -> str:
    """A share as people write it: "13 %", "0.02 %", "below 1e-7 %"."""
    if not math.isfinite(share):
        return "not known"
    if share <= SMALLEST:
        return "below 1e-7 %"
    value = 100 * share
    return f"{value:.0f} %" if value >= 1 else f"{Decimal(f'{value:.1g}'):f} %"
