"""What happens where something is raised: a half-done change is undone, a failed rule of the user's is named."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pyrobocop_pyomo.errors import PyRobocopError


@contextmanager
def undone_on_failure(undo: Callable[[], object]) -> Iterator[None]:
    """Undo a change where anything is raised inside, Ctrl-C included."""
    try:
        yield
    except BaseException:
        undo()
        raise


@contextmanager
def failures_as(kind: type[PyRobocopError], where: str) -> Iterator[None]:
    """Raise an error of this package, which names the place, for whatever a user's rule raises inside.

    A rule may be written for single instants, or for the points that there were: elsewhere it may raise anything.
    """
    try:
        yield
    except PyRobocopError:
        raise
    except Exception as error:
        raise kind(f"{where} ({type(error).__name__}: {error}).") from error
