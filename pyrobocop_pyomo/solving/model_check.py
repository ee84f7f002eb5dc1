"""How good a point is, by the user's own expressions, and of what size the sides of its pairs are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import CanonicalPair, active_sources, canonical_form
from pyrobocop_pyomo.modeling.expressions import ExpressionBounds
from pyrobocop_pyomo.modeling.row_violations import number_or_nan, relation_violation, value_of_sum
from pyrobocop_pyomo.modeling.rows_by_rule import RowByRule, bounds_of, content_of, rows_by_component, sum_by_rule
from pyrobocop_pyomo.modeling.shared_nodes import topmost_nodes
from pyrobocop_pyomo.numerics.rounding import MET, ROUNDING
from pyrobocop_pyomo.programs.row_values import RowValues, VariableBounds, largest_terms

from .ipopt_options import IPOPT_TOLERANCE
from .iterates import Tolerances
from .violations import Violation, violation_of


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
            stated = ((row, bounds_of(row)) for row in model.component_data_objects(Constraint, active=True))
            self._rows = [(row, bounds) for row, bounds in stated if bounds != (None, None)]
            self._lower = np.array([-np.inf if lower is None else lower for _, (lower, _) in self._rows], dtype=float)
            self._upper = np.array([np.inf if upper is None else upper for _, (_, upper) in self._rows], dtype=float)
            self._witnesses = _first_middle_and_last([row for row, _ in self._rows])
            free = (variable for variable in model.component_data_objects(Var, active=True) if not variable.fixed)
            self._bounded = VariableBounds(free)
        # What statements of complementarity say beside their pairs: equations, and sides that are at their bounds.
        self._relations = [relation for source in active_sources(model) for relation in canonical_form(source).rows]
        objectives = list(model.component_data_objects(Objective, active=True))
        self.sign = -1.0 if len(objectives) == 1 and not objectives[0].is_minimizing() else 1.0
        self._objective = objectives[0].expr if len(objectives) == 1 else 0.0
        self._sums = list(topmost_nodes([self._objective], lambda node: sum_by_rule(node) is not None))
        self._bodies: RowValues | None = None

    def objective(self) -> float:
        """The user's objective; NaN where it has no value."""
        return number_or_nan(self._objective, known={id(part): value_of_sum(part) for part in self._sums})

    def violated(self, tolerances: Tolerances) -> list[Violation]:
        """Constraints and bounds that do not hold within the tolerance of feasibility."""
        of_rows, of_variables = self._row_violations(), self._bounded.violations()
        rows = np.flatnonzero(of_rows > tolerances.feasibility)  # none is larger by its size
        rows = rows[self._relative(of_rows, rows) > tolerances.feasibility]
        bounded = np.flatnonzero(of_variables / self._bounded.sizes() > tolerances.feasibility)
        found = [violation_of(row, content_of(row), *bounds) for row, bounds in map(self._rows.__getitem__, rows)]
        outside = map(self._bounded.variables.__getitem__, bounded)
        return found + [violation_of(data, data.value, *data.bounds) for data in outside]

    def violations(self, negligible: float = ROUNDING) -> tuple[float, float]:
        """Largest violation, and the largest relative to the size of the row or bound.

        A row is of the size of the largest term that it adds up, and a bound of that of its variable, at the point that
        is on the model; what is smaller than 1 counts as 1. Rows are divided where one of them is violated by more than
        is negligible.
        """
        of_rows, of_variables = self._row_violations(), self._bounded.violations()
        of_relations = [relation_violation(relation, unknown=float("inf")) for relation in self._relations]
        per_rows = [
            (of_rows, self._largest_relative(of_rows) if of_rows.max(initial=0.0) > negligible else of_rows),
            (of_variables, of_variables / self._bounded.sizes()),
            (np.array(of_relations), np.array(of_relations)),
        ]
        worst, relative = (
            max(float(each.max(initial=0.0)) for each in several) for several in zip(*per_rows, strict=True)
        )
        return worst, relative

    def _row_violations(self) -> NDArray[np.float64]:
        if self._bodies is None:
            self._bodies = RowValues([row if row.__class__ is RowByRule else row.body for row, _ in self._rows])
        bodies = self._bodies.values()
        # Programs and these arrays ask a rule for all rows at once: some rows speak for themselves.
        for k, body in self._witnesses.items():
            bodies[k] = number_or_nan(body)
        with np.errstate(invalid="ignore"):
            violations = np.maximum(np.maximum(self._lower - bodies, bodies - self._upper), 0.0)
        return np.where(np.isnan(bodies), np.inf, violations)

    def _largest_relative(self, violations: NDArray[np.float64]) -> NDArray[np.float64]:
        """The violations that can be the largest ones by the sizes of their rows, divided by these."""
        # Sizes are at least 1: what is less than the relative violation of one row cannot be larger than it.
        one = self._relative(violations, np.array([violations.argmax()]))
        return self._relative(violations, np.flatnonzero(violations >= one[0]))

    def _relative(self, violations: NDArray[np.float64], rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """Violations of some rows, divided by the sizes of these where they are above 1."""
        sizes = largest_terms(content_of(self._rows[k][0]) for k in rows.tolist())
        return np.where(np.isfinite(sizes), violations[rows] / np.maximum(1.0, sizes), violations[rows])


class SideSizes:
    """Sizes by component: the sides of a contact over time are of one size, also where it is closed.

    Parameters
    ----------
    pairs : sequence of CanonicalPair
    start : float array, shape (pairs, 2)
        Values of the sides at the start. They count as well: at the answer all sides of a component may be zero.
    """

    def __init__(self, pairs: Sequence[CanonicalPair], start: NDArray[np.float64]) -> None:
        components = [id(pair.source.parent_component()) for pair in pairs]
        self._pairs = pairs
        self._groups = np.unique(np.array(components, dtype=np.int64), return_inverse=True)[1].ravel()
        self._start = start

    def at(self, sides: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sizes of the sides at a point, shape (pairs, 2): at most 1, so that no tolerance becomes larger.

        Parameters
        ----------
        sides : float array, shape (pairs, 2)
            Their values there.
        """
        sizes = self._largest(sides)
        # Below, a side is zero and not small: what a relaxation leaves of it.
        return np.where(sizes < MET, 1.0, np.minimum(sizes, 1.0))

    def are_too_small(self, sides: NDArray[np.float64], tolerance: float) -> NDArray[np.bool_]:
        """The pairs that are met if their sides are zero, and are not if these are small, shape (pairs,).

        Parameters
        ----------
        sides : float array, shape (pairs, 2)
        tolerance : float
            Of the smaller side, relative to its size.
        """
        sizes = self._largest(sides)
        # Runs with the smallest parameters leave less than Ipopt's tolerance of zero.
        small = (sizes > IPOPT_TOLERANCE) & (sizes < MET)
        # What bounds keep as small as that is small all the same, as a force is in units of large masses.
        for place, side in np.argwhere(sizes <= IPOPT_TOLERANCE).tolist():
            pair = self._pairs[place]
            _, most = ExpressionBounds(use_fixed_var_values_as_bounds=True).walk_expression((pair.a, pair.b)[side])
            if 0.0 < most < MET:
                sizes[place, side], small[place, side] = most, True
        relative = sides / np.where(small, sizes, self.at(sides))
        return small.any(axis=1) & (relative.min(axis=1) > tolerance)

    def _largest(self, sides: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of the component, at the start or at the point, shape (pairs, 2)."""
        largest = np.zeros((int(self._groups.max(initial=-1)) + 1, 2))
        for values in (self._start, sides):
            np.maximum.at(largest, self._groups, np.abs(np.nan_to_num(values, posinf=1.0, neginf=-1.0)))
        return largest[self._groups]


def _first_middle_and_last(rows: Sequence[Any]) -> dict[int, Any]:
    """Bodies of three rows of each component, of those that follow a rule, by their positions."""
    positions = [of[i] for of in rows_by_component(rows) for i in {0, len(of) // 2, len(of) - 1}]
    return {k: content_of(rows[k]) for k in positions}
