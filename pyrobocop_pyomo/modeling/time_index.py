"""`TimeIndex`: the ``t`` of a rule where the time that an index stands for is to be found."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyomo.core.expr import numeric_expr

from pyrobocop_pyomo.errors import ModelError

from .expression_arrays import ArrayEntry


class TimeIndex(ArrayEntry):
    """A point of a phase whose time is to be found: a key where something is looked up, the time in a formula.

    As a key it equals the point that it stands for, in Pyomo's components, sets and dictionaries. In a formula it is an
    expression for the time. As a number, and as a condition, it is refused: nobody knows them yet.

    Parameters
    ----------
    point : float
    what : str
        The rule that gets it, in messages.
    phase : PhaseBlock
    """

    __slots__ = ("phase", "point", "what")

    def __init__(self, point: float, label: str, phase: Any) -> None:
        self.point, self.what, self.phase = point, label, phase

    @property
    def expression(self) -> Any:
        """The time; whatever is done with the number of an entry asks for this."""
        return self.phase.time_at(self.point)

    def as_numeric(self) -> Any:
        """Asked by Pyomo's operators and functions."""
        return self.expression

    def __eq__(self, other: object) -> Any:
        if isinstance(other, np.ndarray) or (hasattr(other, "is_numeric_type") and not isinstance(other, TimeIndex)):
            return self.expression == other  # a relation
        return self.point == point_of(other)

    def __hash__(self) -> int:
        return hash(self.point)

    def __reduce__(self) -> Any:
        return TimeIndex, (self.point, self.what, self.phase)

    def __format__(self, how: str) -> str:
        return format(self.point, how)

    def __str__(self) -> str:
        return str(self.point)

    def __repr__(self) -> str:
        return repr(self.point)


def _refused(self: TimeIndex, *_: Any) -> Any:
    raise ModelError(
        f"{self.what} uses t as a number. Start, duration or elements of the phase are to be found, and with them the "
        "time. In formulas of Pyomo's functions t is the time, (t - b.start) / b.duration is the part of the phase "
        "that has passed, and b.points.ord(t) the place of the point. Write pyo.sin(t) instead of math.sin(t), and "
        "give data over time as an rcp.Table."
    )


for _name in (
    "bool",
    "float",
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
