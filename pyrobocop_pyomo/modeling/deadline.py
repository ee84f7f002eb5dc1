"""`Deadline`: until when work may go on, as a value that is handed from call to call.

Ctrl-C reaches the main thread alone, which tells others that work for it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass(frozen=True)
class Deadline:
    """A point in time after which no new work is started, or none.

    Attributes
    ----------
    end : float or None
        On the clock `time.perf_counter`; None without a limit.
    """

    end: float | None = None

    @classmethod
    def after(cls, seconds: float | None) -> Deadline:
        """The deadline in so many seconds from now; without a number there is none."""
        return cls(None if seconds is None else time.perf_counter() + seconds)

    @property
    def left(self) -> float | None:
        """Seconds that are left, negative when it has passed; None without a limit."""
        return None if self.end is None else self.end - time.perf_counter()

    @property
    def has_passed(self) -> bool:
        """Whether no new work may be started."""
        return self.end is not None and time.perf_counter() >= self.end

    def earlier_by(self, seconds: float) -> Deadline:
        """So many seconds before this one: they are left to what follows."""
        return Deadline(None if self.end is None else self.end - seconds)

    def within(self, seconds: float | None) -> Deadline:
        """The earlier one of this deadline and the one in so many seconds."""
        if seconds is None:
            return self
        end = time.perf_counter() + seconds
        return Deadline(end if self.end is None else min(self.end, end))


NO_DEADLINE = Deadline()

# By the identity of a thread that works for another one: whether it was told to stop.
_STOPPED: dict[int, bool] = {}


@contextmanager
def stoppable_thread() -> Iterator[None]:
    """Let `stop_threads` stop what this thread does inside."""
    _STOPPED[threading.get_ident()] = False
    try:
        yield
    finally:
        del _STOPPED[threading.get_ident()]


def stop_threads() -> None:
    """Tell all threads that can be stopped."""
    _STOPPED.update(dict.fromkeys(_STOPPED, True))


def is_stopped() -> bool:
    """Whether this thread was told to stop."""
    return _STOPPED.get(threading.get_ident(), False)
