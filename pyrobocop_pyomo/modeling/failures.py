"""What happens where something is raised: a half-done change is undone, a failed rule of the user's is named.

An exception that reaches the user is not logged by Pyomo as well.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from pyrobocop_pyomo.errors import PyRobocopError

# What Pyomo logs, before it lets the exception of a component's construction go on.
_LOGGER = logging.getLogger("pyomo.core")
_OPENING = "Constructing component"


@contextmanager
def undone_on_failure(undo: Callable[[], object]) -> Iterator[None]:
    """Undo a change where anything is raised inside, Ctrl-C included."""
    with ExitStack() as at_the_end:
        at_the_end.callback(undo)
        yield
        at_the_end.pop_all()


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


class _SaidByException(logging.Filter):
    """Drops the one record that repeats an exception of this package."""

    def __init__(self) -> None:
        super().__init__()
        self.message: str | None = None

    def filter(self, record: logging.LogRecord) -> bool:
        if self.message is None or not str(record.msg).startswith(_OPENING):
            return True
        repeats = isinstance(record.args, tuple) and str(record.args[-1]) == self.message
        self.message = None
        return not repeats


_FILTER = _SaidByException()


def say_once(error: BaseException) -> None:
    """Keep Pyomo from logging an exception that is about to be raised out of ``construct``.

    Parameters
    ----------
    error : exception
        Its message is dropped from the log once, where Pyomo repeats it.
    """
    _FILTER.message = str(error)
    _LOGGER.addFilter(_FILTER)  # a second time, it is there already
