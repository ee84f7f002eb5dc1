"""Progress of long work: a live line on a terminal, an area that is replaced in a notebook, nothing elsewhere."""

from __future__ import annotations

import shutil
import sys
import time
from typing import Any, TextIO

# Work that ends sooner leaves nothing behind in a notebook, whose outputs are kept.
NOTEBOOK_DELAY = 2.0


class Progress:
    """Writes to the terminal behind standard error, if there is one, or into the output of a notebook's cell.

    Parameters
    ----------
    show : bool or None
        None shows progress only where standard error is a terminal, or in a notebook when the work has taken two
        seconds.
    stream : text stream, optional
        Standard error by default.
    """

    def __init__(self, show: bool | None = None, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._notebook = notebook_display() if stream is None and show is not False else None
        self._shown = self._stream.isatty() if show is None else show
        self._start = time.monotonic()
        self._area: Any = None
        self._lines: list[str] = []
        self._live = 0
        self._said: set[str] = set()

    @classmethod
    def of(cls, show: Progress | bool | None) -> Progress:
        """The progress itself, or a new one."""
        return show if isinstance(show, Progress) else cls(show)

    def live(self, text: str) -> None:
        """Replace the current line."""
        if self._notebook is not None:
            self._replace(text)
        elif self._shown:
            # What wraps around could not be replaced: the next line would start below it.
            text = text[: shutil.get_terminal_size().columns - 1]
            self._stream.write("\r" + text.ljust(self._live))
            self._stream.flush()
            self._live = len(text)

    def line(self, text: str) -> None:
        """Write a line that stays."""
        if self._notebook is not None:
            self._lines.append(text)
            self._replace()
        elif self._shown:
            self._stream.write("\r" + text.ljust(self._live) + "\n")
            self._stream.flush()
            self._live = 0

    def line_once(self, text: str) -> None:
        """Write a line that stays, unless it was written before."""
        if text not in self._said:
            self._said.add(text)
            self.line(text)

    def _replace(self, *live: str) -> None:
        shown = {"text/plain": "\n".join([*self._lines, *filter(None, live)])}
        is_empty = self._area is None and not shown["text/plain"]
        if is_empty or time.monotonic() - self._start < NOTEBOOK_DELAY:
            return
        if self._area is None:
            assert self._notebook is not None
            self._area = self._notebook(shown, raw=True, display_id=True, metadata={"progress": True})
        else:
            self._area.update(shown, raw=True, metadata={"progress": True})


def notebook_display() -> Any:
    """IPython's function that shows things in a cell, where this process is the kernel of a notebook; else None."""
    interactive = sys.modules.get("IPython")
    shell = None if interactive is None else interactive.get_ipython()
    # A shell on a terminal has no kernel.
    return None if getattr(shell, "kernel", None) is None else sys.modules["IPython.display"].display
