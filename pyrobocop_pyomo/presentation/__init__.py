"""How objects show themselves: one line for a terminal, a small table for a notebook. Text only, no model."""

from .html import Html, disclosed_text, facts_table, page, paragraph, table
from .presented import Presented, as_html, one_line
from .shares import percent

__all__ = [
    "Html",
    "Presented",
    "as_html",
    "disclosed_text",
    "facts_table",
    "one_line",
    "page",
    "paragraph",
    "percent",
    "table",
]
