"""What happens where something is raised: a half-done change is undone, a failed rule of the user's is named.

An exception that reaches the user is not logged by Pyomo as well.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from pyrobocop_pyomo.errors import PyRobocopError


@contextmanager
def undone_on_failure(undo: Callable[[], object]) -> Iterator[None]:
    """Undo a change where anything is raised inside, Ctrl-C included."""
    with ExitStack() as at_the_end:
        at_the_end.callback(undo)
        yield
        at_the_end.pop_all()


@contextmanager
def failures_as(kind: type[PyRobocopError], where: str, remedy: str = "") -> Iterator[None]:
    """Raise an error of this package, which names the place, for whatever the user's code raises inside.

    A rule may be written for single instants, or for the points that there were: elsewhere it may raise anything.
    """
    try:
        yield
    except PyRobocopError:
        raise
    except Exception as error:
        raise kind(f"{where} ({type(error).__name__}: {error}). {remedy}".rstrip()) from error


def _is_no_repetition(record: logging.LogRecord) -> bool:
    """False for what Pyomo logs before it lets an exception of this package go on, out of ``construct``."""
    return not any(isinstance(given, PyRobocopError) for given in record.args or ())


logging.getLogger("pyomo.core").addFilter(_is_no_repetition)
