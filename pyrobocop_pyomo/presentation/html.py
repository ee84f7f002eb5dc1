"""Tables in HTML that notebooks show: no scripts, and no colours of their own, so that they fit any page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape

# A table of more rows says how many it leaves out.
MOST_ROWS = 40
# Pages other than Jupyter's set no distance between columns.
CELL_STYLE = "text-align: left; padding: 0.1em 1.2em 0.1em 0"


class Html(str):
    """Text that is HTML already, and goes into a table as it is; all other text is escaped."""

    __slots__ = ()


def page(title: str, *parts: str) -> Html:
    """A heading in bold, and below it what was made by the other functions here."""
    return Html(f"<div><div><strong>{escape(title)}</strong></div>{''.join(parts)}</div>")


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> Html:
    """A table with a header; the first column is text, and so are the cells that are `Html`."""
    listed = list(rows)
    shown = listed[:MOST_ROWS]
    head = "".join(f'<th style="{CELL_STYLE}">{escape(name)}</th>' for name in header)
    body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in shown)
    rest = f"<div>... and {len(listed) - len(shown)} more</div>" if len(listed) > len(shown) else ""
    return Html(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{rest}")


def facts_table(facts: Mapping[str, object]) -> Html:
    """A table of two columns: what, and its value. What is None is left out."""
    rows = "".join(
        f'<tr><th scope="row" style="{CELL_STYLE}">{escape(name)}</th>{_cell(value)}</tr>'
        for name, value in facts.items()
        if value is not None
    )
    return Html(f"<table><tbody>{rows}</tbody></table>")


def paragraph(text: str) -> Html:
    """Text as it is, on lines of its own."""
    return Html(f"<div>{escape(text)}</div>")


def disclosed_text(summary: str, text: str) -> Html:
    """Text as it would be printed, which opens on a click."""
    return Html(f"<details><summary>{escape(summary)}</summary><pre>{escape(text)}</pre></details>")


def _cell(value: object) -> str:
    text = value if isinstance(value, Html) else escape(f"{value:.6g}" if isinstance(value, float) else str(value))
    return f'<td style="{CELL_STYLE}">{text}</td>'
