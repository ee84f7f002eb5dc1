"""A point of a model that may grow: the values of its free variables by variable, to go back to."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.var import Var


class Point:
    """The values of all free variables of the active parts of a model, now.

    Unlike a list of values it can be put back after variables were added or removed: the rest stays as it is.

    Parameters
    ----------
    model : Block
    """

    def __init__(self, model: Any) -> None:
        variables = model.component_data_objects(Var, active=True)
        self._values = [(variable, variable.value) for variable in variables if not variable.fixed]

    def restore(self) -> None:
        """Put the values back; they may violate bounds by a solver's tolerance."""
        for variable, number in self._values:
            if variable.parent_component() is not None:
                variable.set_value(number, skip_validation=True)
