"""The values of a model's free variables, to keep and to put back."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.var import Var

Values = list[float | None]


class VariableValues:
    """Reads and writes the values of all free variables of the active parts of a model.

    Parameters
    ----------
    model : Block
    """

    def __init__(self, model: Any) -> None:
        self._variables = [v for v in model.component_data_objects(Var, active=True) if not v.fixed]

    def read(self) -> Values:
        """The values now."""
        return [variable.value for variable in self._variables]

    def write(self, values: Values) -> None:
        """Put values back; they may violate bounds by a solver's tolerance."""
        for variable, number in zip(self._variables, values, strict=True):
            variable.set_value(number, skip_validation=True)
