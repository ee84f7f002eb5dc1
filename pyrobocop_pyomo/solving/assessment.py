"""How good a point is, by the model's own expressions: nothing that a solver says is used."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var

from pyrobocop_pyomo.modeling.row_violations import bound_violation, number_or_nan


class PointJudge:
    """Evaluates what the user stated at the model's current values.

    Made before a relaxation is applied, so that generated rows and penalties are not mistaken for the user's.

    Parameters
    ----------
    model : Block

    Attributes
    ----------
    sign : float
        1 where the objective is minimised, -1 where it is maximised.
    """

    def __init__(self, model: Any) -> None:
        rows = (row.to_bounded_expression(True) for row in model.component_data_objects(Constraint, active=True))
        self._rows = [(body, lower, upper) for lower, body, upper in rows if lower is not None or upper is not None]
        self._bounded = [
            variable
            for variable in model.component_data_objects(Var, active=True)
            if not variable.fixed and variable.bounds != (None, None)
        ]
        objectives = list(model.component_data_objects(Objective, active=True))
        self.sign = -1.0 if len(objectives) == 1 and not objectives[0].is_minimizing() else 1.0
        self._objective = objectives[0].expr if len(objectives) == 1 else 0.0

    def objective(self) -> float:
        """The user's objective; NaN where it has no value."""
        return number_or_nan(self._objective)

    def violation(self) -> float:
        """Largest violation of a constraint or a variable's bound; NaN counts as infinite."""
        worst = 0.0
        for body, lower, upper in self._rows:
            worst = max(worst, bound_violation(number_or_nan(body), lower, upper))
        for variable in self._bounded:
            if variable.value is not None:
                worst = max(worst, bound_violation(variable.value, variable.lb, variable.ub))
        return worst
