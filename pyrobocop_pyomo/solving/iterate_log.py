"""How good a point is, by the user's own expressions, and the log of all points that runs ended at."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import (
    CanonicalPair,
    PairResidual,
    active_sources,
    canonical_form,
    pair_residuals,
    side_values,
)
from pyrobocop_pyomo.modeling.row_violations import bound_violation, number_or_nan, relation_violation

from .iterates import Iterate
from .progress import Progress

logger = logging.getLogger(__name__)


class ModelCheck:
    """Evaluates what the user stated at the model's current values; nothing that a solver says is used.

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
        self._constraints = list(model.component_data_objects(Constraint, active=True))
        self.read_bounds()
        self._bounded = [
            variable
            for variable in model.component_data_objects(Var, active=True)
            if not variable.fixed and variable.bounds != (None, None)
        ]
        # What statements of complementarity say beside their pairs: equations, and sides that are at their bounds.
        self._relations = [relation for source in active_sources(model) for relation in canonical_form(source).rows]
        objectives = list(model.component_data_objects(Objective, active=True))
        self.sign = -1.0 if len(objectives) == 1 and not objectives[0].is_minimizing() else 1.0
        self._objective = objectives[0].expr if len(objectives) == 1 else 0.0

    def read_bounds(self) -> None:
        """Read the bounds of the constraints again: mutable Params in them may have changed."""
        rows = (row.to_bounded_expression(True) for row in self._constraints)
        self._rows = [(body, lower, upper) for lower, body, upper in rows if lower is not None or upper is not None]

    def objective(self) -> float:
        """The user's objective; NaN where it has no value."""
        return number_or_nan(self._objective)

    def violation(self) -> float:
        """Largest violation of a constraint or a variable's bound; NaN counts as infinite."""
        worst = 0.0
        for body, lower, upper in self._rows:
            worst = max(worst, bound_violation(number_or_nan(body), lower, upper))
        for relation in self._relations:
            worst = max(worst, relation_violation(relation, unknown=float("inf")))
        for variable in self._bounded:
            if variable.value is not None:
                worst = max(worst, bound_violation(variable.value, variable.lb, variable.ub))
        return worst


class IterateLog:
    """Checks the point on the model after each run and keeps the record.

    Parameters
    ----------
    check : ModelCheck
    progress : Progress

    Attributes
    ----------
    pairs : sequence of CanonicalPair
        To be checked.
    steps : list of Iterate
        Without values and multipliers.
    seconds : float
        Elapsed in checking.
    """

    def __init__(self, check: ModelCheck, progress: Progress) -> None:
        self._check, self._progress = check, progress
        self.pairs: Sequence[CanonicalPair] = ()
        self.steps: list[Iterate] = []
        self.seconds = 0.0

    def add(self, iterate: Iterate, *, at: Iterate | None = None, on_the_way: bool = False) -> Iterate:
        """Check the point on the model, and log the run that ended there.

        Parameters
        ----------
        iterate : Iterate
            Not checked yet.
        at : Iterate, optional
            One that was checked at the very same point: its residuals are taken over.
        on_the_way : bool
            Leave the violation as the session found it by the compiled functions: the user's own expressions are
            evaluated where it counts.
        """
        if at is None:
            iterate = self.checked(iterate, on_the_way=on_the_way)
        else:
            names = ("objective", "constraint_violation", "largest_product", "largest_natural_residual")
            iterate = replace(iterate, **{name: getattr(at, name) for name in names})
        iterate = replace(iterate, number=len(self.steps))
        self.steps.append(iterate.record())
        self._progress.line(str(iterate))
        logger.info("%s", iterate)
        return iterate

    def checked(self, iterate: Iterate, *, on_the_way: bool = False) -> Iterate:
        """The iterate with the residuals of the point on the model; see `add`."""
        started = time.perf_counter()
        sides = np.array([side_values(pair) for pair in self.pairs]).reshape(-1, 2)
        violation = iterate.constraint_violation if on_the_way else self._check.violation()
        checked = replace(
            iterate,
            objective=self._check.objective(),
            constraint_violation=max(violation, float(-sides.min(initial=0.0))),
            largest_product=float(np.abs(sides.prod(axis=1)).max(initial=0.0)),
            largest_natural_residual=float(np.abs(sides.min(axis=1)).max(initial=0.0)),
        )
        self.seconds += time.perf_counter() - started
        return checked

    def residuals(self) -> list[PairResidual]:
        """The pairs at the model's current values."""
        return pair_residuals(self.pairs)
