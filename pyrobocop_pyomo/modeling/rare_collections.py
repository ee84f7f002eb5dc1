"""Fewer collections of garbage while a model is solved, which makes many objects that live on."""

from __future__ import annotations

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager

# Objects made, beyond those that were freed, before the youngest are looked through. Python's 700 make it go through
# all parts of a model again and again, which takes a tenth of the time of a plan among many obstacles.
SELDOM = 200_000

_lock = threading.Lock()
_inside = 0
_before = gc.get_threshold()


@contextmanager
def rare_collections() -> Iterator[None]:
    """Raise the threshold of the garbage collector, unless it is off or higher; put it back after the last user."""
    global _inside, _before
    with _lock:
        _inside += 1
        if _inside == 1:
            _before = gc.get_threshold()
            if 0 < _before[0] < SELDOM:
                gc.set_threshold(SELDOM, *_before[1:])
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if not _inside:
                gc.set_threshold(*_before)
