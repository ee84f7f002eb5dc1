"""`Presented`: base of what shows itself in one line on a terminal, and as a small table in a notebook."""

from __future__ import annotations

from typing import Any

from .html import Html, disclosed_text, page

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


def as_html(kind: str, summary: str, parts: list[str]) -> Html:
    """The same as a page: kind and summary, then the parts."""
    return page(f"{kind}: {summary}" if summary else kind, *parts)
