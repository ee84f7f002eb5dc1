"""An exception that reaches the user is not logged by Pyomo as well."""

from __future__ import annotations

import logging

# What Pyomo logs, before it lets the exception of a component's construction go on.
_LOGGER = logging.getLogger("pyomo.core")
_OPENING = "Constructing component"


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
