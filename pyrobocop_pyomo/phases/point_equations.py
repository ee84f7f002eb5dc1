"""The stated equations at one instant, as numbers: rates of explicit states and residuals of the rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pyomo.core.expr.numvalue import value
from pyomo.core.expr.relational_expr import EqualityExpression

from pyrobocop_pyomo.numerics import Grid

from .answers import labelled_rows
from .declarations import Parameter
from .point_model import PointModel
from .record import PhaseRecord


class PointEquations:
    """Asks the user's rules at given values.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    indices, grid : Grid
        The same grid in time indices and in real time.
    parameters : mapping of name to number, optional
        As the phase holds them by default.
    """

    def __init__(
        self,
        block: Any,
        record: PhaseRecord,
        indices: Grid,
        grid: Grid,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self._point = PointModel(block, record, indices, grid)
        self._odes = [statement for statement in record.statements if statement.kind == "ode"]
        self._residuals = [statement for statement in record.statements if statement.kind == "residual"]
        held = {name: block.component(name).value for name in record.names(Parameter)}
        self.parameters = {name: float(each) for name, each in {**held, **(parameters or {})}.items()}
        self._point.set_values(self.parameters)

    def index(self, time: float) -> float:
        """The time index of a real time."""
        return self._point.index(time)

    def rates(
        self, time: float, values: Mapping[str, float], slopes: Mapping[str, float] | None = None
    ) -> dict[str, float]:
        """Derivatives that odes state, at a time index; slopes are those of the other states."""
        self._point.forget_derivatives()  # those of an instant before would be read as if they were of this one
        self._point.set_values(values, slopes)
        return {
            self._point.state_name(state): float(value(rate))
            for statement in self._odes
            for state, rate in self._point.ask(statement, time).items()
        }

    def residuals(self, time: float, slopes: Mapping[str, float]) -> list[float]:
        """Left minus right side of each residual equation, at the values last set and all the slopes."""
        self._point.set_values({}, slopes)
        return [
            _signed(row)
            for statement in self._residuals
            for row in labelled_rows("residual", self._point.ask(statement, time)).values()
        ]


def _signed(row: Any) -> float:
    if isinstance(row, EqualityExpression):
        left, right = row.args
        return float(value(left)) - float(value(right))
    if isinstance(row, tuple):
        return float(value(row[0])) - float(value(row[1]))
    return float(value(row))
