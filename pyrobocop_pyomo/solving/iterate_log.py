"""How good a point is, by the user's own expressions, and the log of all points that runs ended at."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import (
    CanonicalPair,
    PairResidual,
    SidePart,
    active_sources,
    canonical_form,
    side_values,
)
from pyrobocop_pyomo.modeling.row_violations import relation_violation
from pyrobocop_pyomo.modeling.rows_on_read import bounds_of, content_of, is_unread
from pyrobocop_pyomo.modeling.variable_bounds import VariableBounds
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.programs.row_values import RowTerms, RowValues, SumValue

from .iterates import Iterate, Tolerances
from .progress import Progress
from .side_sizes import SideSizes
from .violations import Violation, violations_of_pairs, worst_row_of_each_component

logger = logging.getLogger(__name__)

# From so many pairs on, their sides are evaluated as arrays.
MANY_PAIRS = 20


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
        with PauseGC():  # many small objects, all of which live on
            self._constraints = list(model.component_data_objects(Constraint, active=True))
            self.read_bounds()
            free = (variable for variable in model.component_data_objects(Var, active=True) if not variable.fixed)
            self._bounded = VariableBounds(free)
        # What statements of complementarity say beside their pairs: equations, and sides that are at their bounds.
        self._relations = [relation for source in active_sources(model) for relation in canonical_form(source).rows]
        objectives = list(model.component_data_objects(Objective, active=True))
        self.sign = -1.0 if len(objectives) == 1 and not objectives[0].is_minimizing() else 1.0
        self._objective = objectives[0].expr if len(objectives) == 1 else 0.0
        self._sum: SumValue | None = None

    def read_bounds(self) -> None:
        """Read the bounds of the constraints again: mutable Params in them may have changed."""
        rows = ((row, bounds_of(row)) for row in self._constraints)
        self._rows = [(row, bounds) for row, bounds in rows if bounds != (None, None)]
        self._lower = np.array([-np.inf if lower is None else lower for _, (lower, _) in self._rows], dtype=float)
        self._upper = np.array([np.inf if upper is None else upper for _, (_, upper) in self._rows], dtype=float)
        self._bodies: RowValues | None = None
        self._terms: tuple[NDArray[np.intp], RowTerms] | None = None

    def objective(self) -> float:
        """The user's objective; NaN where it has no value."""
        if self._sum is None or not self._sum.is_current:
            self._sum = SumValue(self._objective)
        return self._sum.value()

    def violation(self) -> float:
        """Largest violation of a constraint or a variable's bound; NaN counts as infinite."""
        return self.violations()[0]

    def violated(self, tolerances: Tolerances) -> list[Violation]:
        """Constraints and bounds that do not hold within the tolerance of feasibility, the worst of each component."""
        of_rows, of_variables = self._row_violations(), self._bounded.violations()
        rows = np.flatnonzero(of_rows > tolerances.feasibility)  # none is larger by its size
        rows = rows[self._relative(of_rows, rows) > tolerances.feasibility]
        bounded = np.flatnonzero(of_variables / self._bounded.sizes() > tolerances.feasibility)
        violated = [(row, content_of(row), *bounds) for row, bounds in map(self._rows.__getitem__, rows)]
        violated += [(data, data.value, *data.bounds) for data in map(self._bounded.variables.__getitem__, bounded)]
        return list(worst_row_of_each_component(violated))

    def violations(self) -> tuple[float, float]:
        """Largest violation, and the largest where each is divided by the size of what it is a violation of.

        A row is of the size of the largest term that it adds up, and a bound of that of its variable, at the point that
        is on the model; what is smaller than 1 counts as 1.
        """
        of_rows, of_variables = self._row_violations(), self._bounded.violations()
        of_relations = [relation_violation(relation, unknown=float("inf")) for relation in self._relations]
        found = [
            (of_rows, self._largest_relative(of_rows)),
            (of_variables, of_variables / self._bounded.sizes()),
            (np.array(of_relations), np.array(of_relations)),
        ]
        worst, relative = (
            max(float(each.max(initial=0.0)) for each in several) for several in zip(*found, strict=True)
        )
        return worst, relative

    def _row_violations(self) -> NDArray[np.float64]:
        if self._bodies is None or not self._bodies.is_current:
            self._bodies = RowValues([row if is_unread(row) else row.body for row, _ in self._rows])
        bodies = self._bodies.values()
        with np.errstate(invalid="ignore"):
            violations = np.maximum(np.maximum(self._lower - bodies, bodies - self._upper), 0.0)
        return np.where(np.isnan(bodies), np.inf, violations)

    def _largest_relative(self, violations: NDArray[np.float64]) -> NDArray[np.float64]:
        """The violations that can be the largest ones by the sizes of their rows, divided by these."""
        if not violations.max(initial=0.0) > ROUNDING:
            return violations  # whatever the sizes
        # Sizes are at least 1: what is less than the relative violation of one row cannot be larger than it.
        one = self._relative(violations, np.array([violations.argmax()]))
        return self._relative(violations, np.flatnonzero(violations >= one[0]))

    def _relative(self, violations: NDArray[np.float64], rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """Violations of some rows, divided by the sizes of these where they are above 1."""
        if self._terms is None or not np.array_equal(self._terms[0], rows) or not self._terms[1].is_current:
            self._terms = rows, RowTerms([content_of(self._rows[k][0]) for k in rows.tolist()])
        sizes = self._terms[1].largest()
        return np.where(np.isfinite(sizes), violations[rows] / np.maximum(1.0, sizes), violations[rows])


class IterateLog:
    """Checks the point on the model after each run and keeps the record.

    Parameters
    ----------
    check : ModelCheck
    progress : Progress

    Attributes
    ----------
    pairs : sequence of CanonicalPair
        To be checked; set when the start is on the model.
    steps : list of Iterate
        Without values and multipliers.
    seconds : float
        Elapsed in checking.
    """

    def __init__(self, check: ModelCheck, progress: Progress) -> None:
        self._check, self._progress = check, progress
        self._pairs: Sequence[CanonicalPair] = ()
        self._sizes = SideSizes((), np.empty((0, 2)))
        self._side_values: tuple[Sequence[CanonicalPair], RowValues] | None = None
        self.steps: list[Iterate] = []
        self.seconds = 0.0

    @property
    def iterations(self) -> int:
        """Those of Ipopt, in all runs so far."""
        return sum(step.iterations for step in self.steps)

    @property
    def pairs(self) -> Sequence[CanonicalPair]:
        """The pairs that are checked."""
        return self._pairs

    @pairs.setter
    def pairs(self, pairs: Sequence[CanonicalPair]) -> None:
        known = len(self._pairs) == len(pairs)  # again, by another backend or relaxation
        self._pairs = pairs
        if not known:
            self._sizes = SideSizes(pairs, self._sides())

    def add(
        self, iterate: Iterate, *, at: Iterate | None = None, on_the_way: bool = False, exact: bool = False
    ) -> Iterate:
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
        exact : bool
            Whether one side of each pair was held at zero, whatever rounding leaves of it.
        """
        if at is None:
            iterate = self.checked(iterate, on_the_way=on_the_way, exact=exact)
        else:
            names: tuple[str, ...] = ("objective", "constraint_violation", "relative_violation")
            names += ("largest_product", "largest_natural_residual", "relative_product", "relative_natural_residual")
            iterate = replace(iterate, **{name: getattr(at, name) for name in names})
        iterate = replace(iterate, number=len(self.steps))
        self.steps.append(iterate.record())
        line = iterate.line(pairs=bool(self.pairs))
        self._progress.line(line)
        logger.info("%s", line)
        return iterate

    def checked(self, iterate: Iterate, *, on_the_way: bool = False, exact: bool = False) -> Iterate:
        """The iterate with the residuals of the point on the model; see `add`."""
        started = time.perf_counter()
        sides = self._sides()
        violation, relative = (iterate.constraint_violation,) * 2 if on_the_way else self._check.violations()
        if np.isnan(sides).any():  # an expression without a value is infinitely far from what is required of it
            sides = np.full_like(sides, -np.inf)
        least_side = float(-sides.min(initial=0.0))
        checked = replace(
            iterate,
            objective=self._check.objective(),
            constraint_violation=max(violation, least_side),
            relative_violation=max(relative, least_side),
            largest_product=_largest_product(sides),
            largest_natural_residual=_largest_natural_residual(sides),
        )
        if not exact:
            relative_sides = sides / self._sizes.at(sides)
            checked = replace(
                checked,
                relative_product=_largest_product(relative_sides),
                relative_natural_residual=_largest_natural_residual(relative_sides),
            )
        self.seconds += time.perf_counter() - started
        return checked

    def _sides(self) -> NDArray[np.float64]:
        """Values of both sides of each pair, shape (pairs, 2)."""
        pairs = self.pairs
        whole = all(part is SidePart.WHOLE for pair in pairs for part in (pair.a_part, pair.b_part))
        if whole and len(pairs) >= MANY_PAIRS:
            known = self._side_values
            if known is None or known[0] is not pairs or not known[1].is_current:
                known = self._side_values = (pairs, RowValues([side for pair in pairs for side in (pair.a, pair.b)]))
            sides = known[1].values().reshape(-1, 2)
            if not np.isnan(sides).any():
                return sides
        return np.array([side_values(pair, unknown=np.nan) for pair in pairs]).reshape(-1, 2)

    def unmet(self, tolerances: Tolerances) -> list[Violation]:
        """Pairs that are not met at the model's current values, the sides relative to their sizes."""
        sizes = self._sizes.at(self._sides())
        return list(violations_of_pairs(self.residuals(), tolerances, sizes.prod(axis=1).tolist()))

    def too_small(self, tolerances: Tolerances) -> list[CanonicalPair]:
        """Pairs that are met only if what their sides have left is zero and not small."""
        found = self._sizes.too_small(self._sides(), tolerances.natural)
        return [self.pairs[place] for place in np.flatnonzero(found).tolist()]

    def residuals(self) -> list[PairResidual]:
        """The pairs at the model's current values."""
        return [PairResidual(pair.name, *sides) for pair, sides in zip(self.pairs, self._sides().tolist(), strict=True)]


def _largest_product(sides: NDArray[np.float64]) -> float:
    return float(np.abs(sides.prod(axis=1)).max(initial=0.0))


def _largest_natural_residual(sides: NDArray[np.float64]) -> float:
    return float(np.abs(sides.min(axis=1)).max(initial=0.0))
