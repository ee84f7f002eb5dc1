"""Rules that have to know the time as a number: they were asked at each point of the mesh while the model was built.

What they say at other times nobody has looked at. Such a phase keeps its mesh, and its errors between the points are
not known.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pyrobocop_pyomo.errors import TrajectoryError

from .declarations import FunctionOfTime
from .record import Statement


def asked_by_point(phase: Any) -> str | None:
    """The first rule of a phase, or function for a history, that is no template, in words; None where all are.

    Parameters
    ----------
    phase : PhaseBlock
    """
    record = phase.record
    found = next((each for each in record.rules if not each.rule.is_template(phase)), None)
    if found is not None:
        return _in_words(phase, found)
    for name, declaration in record.declarations.items():
        function = getattr(declaration, "history", None)
        if isinstance(function, FunctionOfTime) and function.is_asked_by_point:
            return _of_history(phase, name)
    return None


def refuse_asked_by_point(phase: Any, statement: Statement, *more: Any) -> None:
    """Refuse a rule that says something at the points of the mesh only, given what it would get at one.

    Raises
    ------
    TrajectoryError
        Naming it.
    """
    if not statement.rule.is_template(phase, *more):
        raise TrajectoryError(_in_words(phase, statement))


def known_history(phase: Any, name: str, times: Sequence[float], slack: float) -> list[float]:
    """Times before the start, or those beside them for which a history by a function has said something.

    Parameters
    ----------
    phase : PhaseBlock
    name : str
    times : sequence of float
    slack : float
        What may be between these.

    Raises
    ------
    TrajectoryError
        When the function has to know the time as a number, and was not asked for one of them.
    """
    history = getattr(phase.record.declarations[name], "history", None)
    if not isinstance(history, FunctionOfTime) or not history.is_asked_by_point:
        return list(times)
    known = [said for time in times if (said := history.known_time(time, slack)) is not None]
    if len(known) < len(times):
        raise TrajectoryError(_of_history(phase, name))
    return known


def _of_history(phase: Any, name: str) -> str:
    declared_at = phase.record.declarations[name].declared_at
    return _reason(phase, f"the function for the history of '{name}' (declared at {declared_at})")


def _in_words(phase: Any, statement: Statement) -> str:
    code = getattr(statement.rule.rule, "__code__", None)
    line = "" if code is None else f" ({Path(code.co_filename).name}:{code.co_firstlineno})"
    return _reason(phase, f"the rule of its {statement.kind} '{statement.name}'{line}")


def _reason(phase: Any, what: str) -> str:
    return (
        f"phase '{phase.name}': {what} has to know the time as a number, and was asked at the points of the mesh: what "
        "it says between them is not known. Write pyo.Expr_if for a branch, rcp.Table for data over time, pyo.sin for "
        "math.sin, x.delayed(t, delay) for an earlier time."
    )


def read_inside_elements(phase: Any) -> str | None:
    """The times inside elements at which statements read values, in words; None where all are element boundaries.

    Parameters
    ----------
    phase : PhaseBlock
    """
    boundaries = phase.grid.mesh.boundaries
    inside = [time for time in sorted(phase.record.named_times) if time not in boundaries]
    if not inside:
        return None
    more = f" and at {len(inside) - 1} times more" if len(inside) > 1 else ""
    return (
        f"Statements read values of phase '{phase.name}' at t = {inside[0]:g}{more}, inside of elements, where the "
        "polynomial is less exact than at their ends. Make these times element boundaries: PhaseBlock(mesh=...)."
    )
