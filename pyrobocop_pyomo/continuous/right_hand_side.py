"""What stands under the name of a derivative that its right-hand side replaces."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.expression import ExpressionData
from pyomo.core.expr.numvalue import value as numeric_value


class RightHandSide(ExpressionData):
    """The right-hand side that replaces a derivative; it has a value, and can be fixed, as a variable can.

    Fixing activates the equation ``dx[t] == f``, with the derivative in it as a fixed variable: a condition, such as a
    steady start. So it does not matter whether a derivative is fixed before or after the transformation.
    """

    __slots__ = ("_derivative", "_row")

    def __init__(self, side: Any, component: Any, derivative: Any, row: Any) -> None:
        super().__init__(side, component)
        self._derivative = derivative
        self._row = row

    @property
    def value(self) -> float | None:
        """The value of the derivative; None where something in it has none."""
        return self._derivative.value if self.fixed else numeric_value(self, exception=False)

    @property
    def fixed(self) -> bool:
        """Whether the derivative is fixed here."""
        return bool(self._row.active)

    def fix(self, *value: Any, skip_validation: bool = False) -> None:
        """Fix the derivative, at a number or at its value."""
        self._derivative.fix(*(value or (self.value,)), skip_validation=skip_validation)
        self._row.activate()

    def unfix(self) -> None:
        """Take back `fix`."""
        self._row.deactivate()
        self._derivative.fix(None, skip_validation=True)

    free = unfix
