"""`TimeIndex`: the ``t`` of a rule where it is an index and no time."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyomo.core.expr import numeric_expr

from pyrobocop_pyomo.errors import TranscriptionError

from .expression_arrays import ArrayEntry


class TimeIndex(ArrayEntry):
    """A point of a phase whose time is to be found: it finds what is there, but it is no number.

    As a key it equals the point that it stands for, in Pyomo's components, sets and dictionaries. In a formula, in a
    function and in a comparison it would be taken for the time, which it is not: all of these are refused.

    Parameters
    ----------
    point : float
    what : str
        The rule that gets it, in messages.
    """

    __slots__ = ("point", "what")

    def __init__(self, point: float, what: str) -> None:
        self.point, self.what = point, what

    @property
    def expression(self) -> Any:
        """Whatever is done with the number of an entry asks for this."""
        raise TranscriptionError(
            f"{self.what} uses t as a number. Start, duration or elements of the phase are to be found: t then is an "
            "index that runs from 0 to 1, and no time. Write b.time_at(t) for the time, (b.time_at(t) - b.start) / "
            "b.duration for the part of the phase that has passed, and b.points.ord(t) for the place of the point."
        )

    def as_numeric(self) -> Any:
        """Asked by Pyomo's operators and functions."""
        return self.expression

    def __eq__(self, other: object) -> Any:
        if isinstance(other, np.ndarray) or (hasattr(other, "is_numeric_type") and not isinstance(other, TimeIndex)):
            return self.expression  # it would be a relation
        return self.point == point_of(other)

    def __hash__(self) -> int:
        return hash(self.point)

    def __reduce__(self) -> Any:
        return TimeIndex, (self.point, self.what)

    def __format__(self, how: str) -> str:
        return format(self.point, how)

    def __str__(self) -> str:
        return str(self.point)

    def __repr__(self) -> str:
        return repr(self.point)


def _refused(self: TimeIndex, *_: Any) -> Any:
    return self.expression


for _name in (
    "abs",
    "neg",
    "pos",
    "round",
    "floordiv",
    "rfloordiv",
    "mod",
    "rmod",
    "divmod",
    "rdivmod",
    "int",
    "trunc",
):
    setattr(TimeIndex, f"__{_name}__", _refused)

numeric_expr.register_arg_type(TimeIndex, numeric_expr.ARG_TYPE.ASNUMERIC)


def point_of(t: Any) -> Any:
    """The point that an index stands for, as a number."""
    return t.point if isinstance(t, TimeIndex) else t
