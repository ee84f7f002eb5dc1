"""Tables for people: aligned columns, printed row by row as the numbers arrive."""

from __future__ import annotations

import sys
from collections.abc import Sequence


class Table:
    """A table whose column widths are known beforehand, so that a row can be shown as soon as it is measured.

    Parameters
    ----------
    columns : sequence of (title, format)
        The format is Python's, with a width: ``">9.3f"``; text is aligned by it, missing numbers are shown as "-".
    """

    def __init__(self, columns: Sequence[tuple[str, str]]) -> None:
        self._columns = list(columns)
        self.rows: list[tuple[object, ...]] = []

    def header(self) -> None:
        """Print the titles."""
        titles = "  ".join(self._text(title, style) for title, style in self._columns)
        print(titles, "-" * len(titles), sep="\n", flush=True)

    def add(self, *values: object) -> None:
        """Print a row and keep it."""
        self.rows.append(values)
        cells = (
            self._text(value, style) if value is None or isinstance(value, str) else format(value, style)
            for value, (_, style) in zip(values, self._columns, strict=True)
        )
        print("  ".join(cells).rstrip(), flush=True)

    @staticmethod
    def _text(value: object, style: str) -> str:
        width = style.lstrip("<>").split(".")[0].rstrip("defgs")
        return format("-" if value is None else value, f"{style[0]}{width}")


def show_progress(text: str) -> None:
    """Overwrite one line on a terminal, and say nothing elsewhere."""
    if sys.stderr.isatty():
        print(f"\r\x1b[2K{text}", end="", file=sys.stderr, flush=True)


def markdown(titles: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> str:
    """The rows as a table of a page.

    Parameters
    ----------
    titles : sequence of str
    rows : sequence of sequences of str
    left : int
        How many columns are aligned to the left; numbers follow.
    """
    rule = ["---" if i < left else "---:" for i in range(len(titles))]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (titles, rule, *rows))


def cells_of(rows: Sequence[Sequence[object]], columns: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Values as text, in the formats of a `Table` without their widths."""
    formats = [style.lstrip("<>").lstrip("0123456789") for _, style in columns]
    return [
        ["-" if value is None else format(value, style) for value, style in zip(row, formats, strict=True)]
        for row in rows
    ]
