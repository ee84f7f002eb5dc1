"""Ctrl-C during a run of C code that calls back into Python."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any


class Interruption:
    """Context that turns the first Ctrl-C into a request, which the callbacks of the run look at.

    The second Ctrl-C finds the handler that was there before (usually the one that raises `KeyboardInterrupt`).
    Outside of the main thread Python gives no access to signals, and the context does nothing.

    Attributes
    ----------
    requested : bool
        Whether Ctrl-C was pressed inside the context.
    """

    def __init__(self) -> None:
        self.requested = False
        self._previous: Any = None

    def __enter__(self) -> Interruption:
        """Watch for Ctrl-C from here on."""
        in_main_thread = threading.current_thread() is threading.main_thread()
        # None: a handler that C code installed, which Python could not put back. Ignored: leave it ignored.
        if in_main_thread and signal.getsignal(signal.SIGINT) not in (None, signal.SIG_IGN):
            self._previous = signal.signal(signal.SIGINT, self._request)
        return self

    def _request(self, number: int, frame: FrameType | None) -> None:
        self.requested = True
        self._restore()

    def _restore(self) -> None:
        if self._previous is not None:
            signal.signal(signal.SIGINT, self._previous)
            self._previous = None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Put the former handler back."""
        self._restore()
