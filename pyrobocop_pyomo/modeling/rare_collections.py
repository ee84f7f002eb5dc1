"""Fewer collections of garbage while a model is solved, which makes many objects that live on."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

# Objects made, beyond those that were freed, before the youngest are looked through. Python's 700 make it go through
# all parts of a model again and again, which takes a tenth of the time of a plan among many obstacles.
SELDOM = 200_000


@contextmanager
def rare_collections() -> Iterator[None]:
    """Raise the threshold of the garbage collector, unless it is off or higher; whoever has raised it puts it back."""
    before = gc.get_threshold()
    if not 0 < before[0] < SELDOM:
        yield
        return
    gc.set_threshold(SELDOM, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)
