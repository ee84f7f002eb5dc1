"""What C code prints: it goes to file descriptor 1 and knows nothing of `sys.stdout`."""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from typing import TextIO

from pyomo.common.tee import capture_output, redirect_fd


def flush_c_streams() -> None:
    """Push out what C code has printed and not yet written; where the C library is not reachable, do nothing."""
    with contextlib.suppress(TypeError, OSError, AttributeError):
        ctypes.CDLL(None).fflush(None)


# Descriptor 1 belongs to all threads. Two that swap it at once may put back what the other one had put there, and
# standard output is lost for good: only one at a time does.
_descriptor = threading.RLock()


def _renew_lock() -> None:
    """In a forked process the thread that held the lock does not exist."""
    global _descriptor
    _descriptor = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_lock)


@contextlib.contextmanager
def c_output_sent_to(streams: Sequence[TextIO]) -> Iterator[None]:
    """Send what C code prints to Python's streams, also in notebooks, while it is printed.

    Threads that ask for this at the same time wait for each other.
    """
    with _descriptor, capture_output([_not_by_descriptor(stream) for stream in streams], capture_fd=True):
        try:
            yield
        finally:
            flush_c_streams()


def standard_output() -> TextIO:
    """`sys.stdout` while no solve of another thread has its own there, which would be closed when it is written to."""
    with _descriptor:
        return sys.stdout


class _Forwarding(io.TextIOBase):
    """A stream that hands everything to another one and has no file descriptor."""

    def __init__(self, target: TextIO) -> None:
        self._target = target

    def write(self, text: str) -> int:
        return self._target.write(text)

    def flush(self) -> None:
        self._target.flush()


def _not_by_descriptor(stream: TextIO) -> TextIO:
    """A notebook's `sys.stdout` names the descriptor of the kernel's terminal, and Pyomo would write there."""
    try:
        stream.fileno()
    except (AttributeError, OSError, ValueError):
        return stream
    ordinary = isinstance(stream, io.TextIOWrapper)
    return stream if ordinary else _Forwarding(stream)  # type: ignore[return-value]


@contextlib.contextmanager
def c_output_captured() -> Iterator[list[str]]:
    """Capture what C code prints; the list holds it, as one text or none, when the context ends.

    For calls of microseconds: what another thread prints meanwhile is captured as well. Pyomo's ``capture_output``
    starts threads and passes on what arrives, which is right for a whole solve and too much here. While another thread
    has the descriptor, nothing is captured.
    """
    captured: list[str] = []
    descriptor = _descriptor
    if not _has_standard_output() or not descriptor.acquire(blocking=False):
        yield captured
        return
    try:
        with contextlib.suppress(ValueError, OSError):
            sys.stdout.flush()
        flush_c_streams()
        with tempfile.TemporaryFile() as file:
            with redirect_fd(1, file.fileno(), synchronize=False):
                yield captured
                flush_c_streams()
            file.seek(0)
            captured.append(file.read().decode(errors="replace"))
    finally:
        descriptor.release()


def _has_standard_output() -> bool:
    """A service may have none."""
    try:
        os.fstat(1)
    except OSError:
        return False
    return True


@contextlib.contextmanager
def c_output_muted() -> Iterator[None]:
    """Drop what C code prints by the way, where no other thread could print meanwhile."""
    with contextlib.ExitStack() as stack:
        if threading.active_count() == 1:
            stack.enter_context(c_output_captured())
        yield
