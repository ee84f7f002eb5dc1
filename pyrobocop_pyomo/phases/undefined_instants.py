"""Which rule of a phase has no value at an instant of a trajectory: expression, rule, element and time, in words."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from pyomo.core.expr.relational_expr import RelationalExpression

from pyrobocop_pyomo.errors import PyRobocopError, TrajectoryError
from pyrobocop_pyomo.modeling.row_violations import number_or_nan
from pyrobocop_pyomo.modeling.undefined_values import undefined_part
from pyrobocop_pyomo.trajectories import Trajectory

from .point_model import PointModel
from .record import PhaseRecord, Statement

_NO_VALUE = (ArithmeticError, ValueError, TypeError)


@contextmanager
def named_where_undefined(
    label: str, point: PointModel, statements: Sequence[Statement], time: float, real_time: float, element: int
) -> Iterator[None]:
    """Let what has no value at an instant be named in the error.

    Parameters
    ----------
    label : str
        The phase, in words.
    point : PointModel
        Holding the values of the instant.
    statements : sequence of Statement
        Whose rules are evaluated.
    time, real_time : float
        The instant, by the index and by the clock.
    element : int

    Raises
    ------
    TrajectoryError
        In place of an error of arithmetic.
    """
    try:
        yield
    except PyRobocopError:
        raise
    except _NO_VALUE as error:
        for statement in statements:
            without = (of for of in _expressions(point, statement, time) if not math.isfinite(number_or_nan(of)))
            part = next((found for of in without if (found := undefined_part(of))), None)
            if part is not None:
                where = f"in the {statement.kind} '{statement.name}' at time {real_time:g} (element {element})"
                raise TrajectoryError(
                    f"{label}: {_named(part.what)}, {where}. The trajectory leaves the values for which it is "
                    "defined; bound what it reads, or solve the model first."
                ) from error
        raise


def refuse_undefined(label: str, record: PhaseRecord, trajectory: Trajectory, point: PointModel) -> None:
    """Ask the equations at the stages of a trajectory, where it says what all signals are.

    Raises
    ------
    TrajectoryError
        Naming the first that has no value.
    """
    scheme, grid = trajectory.grid.scheme, trajectory.grid
    states = {name: trajectory.element_states(name) @ scheme.state_at(scheme.c).T for name in trajectory.states}
    values = states | {name: trajectory.element_signals(name) for name in trajectory.signals}
    statements = record.statements_of("ode") + record.statements_of("residual")
    asks_phase, element = point.asks_phase, point.element
    point.asks_phase = False
    try:
        for i, times in enumerate(grid.stage_times):
            point.element = i
            for k, time in enumerate(times):
                here = {name: float(of[i, k]) for name, of in values.items()}
                here |= {name: float(np.interp(time, *knots)) for name, knots in trajectory.piecewise_linear.items()}
                point.set_values({**here, **trajectory.parameters}, dict.fromkeys(trajectory.states, 0.0))
                index = point.index_at(time)
                with named_where_undefined(label, point, statements, index, time, i):
                    for statement in statements:
                        for expression in _expressions(point, statement, index):
                            if not math.isfinite(number_or_nan(expression)):
                                raise ValueError("no value")
    finally:
        point.asks_phase, point.element = asks_phase, element
        point.leave_nodes()


def _named(words: str) -> str:
    """With the names of the user's for the variables that hold an instant."""
    return re.sub(r"declared\[([^]]*)\]", r"'\1'", words)


def _expressions(point: PointModel, statement: Statement, time: float) -> list[Any]:
    """Everything that a rule says at an instant."""
    found: list[Any] = []
    pending = [point.result_of(statement, time)]
    while pending:
        said = pending.pop()
        if isinstance(said, dict):
            pending.extend(said.values())
        elif isinstance(said, (tuple, list)):
            pending.extend(said)
        elif hasattr(said, "is_expression_type") and said.is_expression_type():
            found.extend(said.args if isinstance(said, RelationalExpression) else [said])
    return found
