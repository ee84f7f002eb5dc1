"""Where in the horizon of a phase a time index lies."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import GuessError


def fraction_of(phase: Any) -> Callable[[float], float]:
    """A function from time indices to 0 (start) ... 1 (end), also where start, duration or elements may move.

    Raises
    ------
    GuessError
        When it is no `PhaseBlock`.
    """
    if not hasattr(phase, "clock") or not hasattr(phase, "time"):
        raise GuessError(f"'{getattr(phase, 'name', phase)}' is no PhaseBlock; a guess along a path needs one.")
    start, end = (float(value(phase.clock(t))) for t in (phase.time.first(), phase.time.last()))
    return lambda t: (float(value(phase.clock(t))) - start) / (end - start)
