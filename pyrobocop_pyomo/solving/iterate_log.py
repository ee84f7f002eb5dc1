"""How good a point is, by the user's own expressions, and the log of all points that runs ended at."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap
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
    scales : ComponentMap
        Of constraints and variables that were scaled.
    """

    def __init__(self, model: Any) -> None:
        self.scales = ComponentMap()
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
        rows = ((row, row.to_bounded_expression(True)) for row in self._constraints)
        self._rows = [
            (row, (body, lower, upper)) for row, (lower, body, upper) in rows if lower is not None or upper is not None
        ]

    def objective(self) -> float:
        """The user's objective; NaN where it has no value."""
        return number_or_nan(self._objective)

    def violation(self) -> float:
        """Largest violation of a constraint or a variable's bound; NaN counts as infinite."""
        return self.violations()[0]

    def violations(self) -> tuple[float, float]:
        """Largest violation, and the largest where each is divided by its scale, if that is above 1."""
        worst = relative = 0.0
        scale_of = self.scales.get
        for constraint, (body, lower, upper) in self._rows:
            violation = bound_violation(number_or_nan(body), lower, upper)
            worst, relative = max(worst, violation), max(relative, violation / max(1.0, scale_of(constraint, 1.0)))
        for relation in self._relations:
            violation = relation_violation(relation, unknown=float("inf"))
            worst, relative = max(worst, violation), max(relative, violation)
        for variable in self._bounded:
            if variable.value is not None:
                violation = bound_violation(variable.value, variable.lb, variable.ub)
                worst, relative = max(worst, violation), max(relative, violation / max(1.0, scale_of(variable, 1.0)))
        return worst, relative


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
            names: tuple[str, ...] = ("objective", "constraint_violation", "relative_violation")
            names += ("largest_product", "largest_natural_residual")
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
        violation, relative = (iterate.constraint_violation,) * 2 if on_the_way else self._check.violations()
        least_side = float(-sides.min(initial=0.0))
        checked = replace(
            iterate,
            objective=self._check.objective(),
            constraint_violation=max(violation, least_side),
            relative_violation=max(relative, least_side) if self._check.scales else None,
            largest_product=float(np.abs(sides.prod(axis=1)).max(initial=0.0)),
            largest_natural_residual=float(np.abs(sides.min(axis=1)).max(initial=0.0)),
        )
        self.seconds += time.perf_counter() - started
        return checked

    def residuals(self) -> list[PairResidual]:
        """The pairs at the model's current values."""
        return pair_residuals(self.pairs)
