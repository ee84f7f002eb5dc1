"""Progress of long work: a live line on a terminal, nothing elsewhere."""

from __future__ import annotations

import shutil
import sys
from typing import TextIO


class Progress:
    """Writes to the terminal behind standard error, if there is one.

    Parameters
    ----------
    show : bool or None
        None shows progress only where standard error is a terminal.
    stream : text stream, optional
        Standard error by default.
    """

    def __init__(self, show: bool | None = None, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._shown = self._stream.isatty() if show is None else show
        self._live = 0
        self._said: set[str] = set()

    def live(self, text: str) -> None:
        """Replace the current line."""
        if self._shown:
            # What wraps around could not be replaced: the next line would start below it.
            text = text[: shutil.get_terminal_size().columns - 1]
            self._stream.write("\r" + text.ljust(self._live))
            self._stream.flush()
            self._live = len(text)

    def line(self, text: str) -> None:
        """Write a line that stays."""
        if self._shown:
            self._stream.write("\r" + text.ljust(self._live) + "\n")
            self._stream.flush()
            self._live = 0

    def line_once(self, text: str) -> None:
        """Write a line that stays, unless it was written before."""
        if text not in self._said:
            self._said.add(text)
            self.line(text)
