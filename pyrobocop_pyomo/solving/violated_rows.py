"""The rows of a model, linearised where it stands, and the step of a linear program that violates them least."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint

from pyrobocop_pyomo.complementarity import CanonicalPair, SidePart
from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.diagnosis.linearised_rows import gradient
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.row_violations import number_or_nan
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.variable_values import put_values
from pyrobocop_pyomo.mpcc.linear_programs import LinearProgram, LinearStatus
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .obstructions import ObstructingData

# Steps of one linear program may take so long without a deadline: seconds.
_LONGEST = 60.0
# Multipliers below this share of the largest possible one are rounding.
_NO_MULTIPLIER = 1e-6
# A variable is at its bound where it is as near as this, in its size.
_AT_BOUND = 1e-7
# Both sides of a pair are at zero below this.
_BIACTIVE = 1e-7


@dataclass(frozen=True, eq=False)
class LinearStep:
    """What a linear program finds.

    Attributes
    ----------
    change : float array, shape (n,)
        Of the variables.
    length : float
        The largest change, in sizes.
    total : float
        Violation of the linearised rows after it, weighted, in sum.
    row_multipliers : float array, shape (m,)
        By how much that grows per unit of a row's active bound.
    """

    change: FloatArray
    length: float
    total: float
    row_multipliers: FloatArray


class StatedRow(NamedTuple):
    """One row: a constraint, or a side of a pair; a bound is None where there is none."""

    data: Any
    body: Any
    lower: float | None
    upper: float | None


def stated_rows(model: Any, pairs: Iterable[CanonicalPair] = ()) -> list[StatedRow]:
    """Active constraints that hold what may move, and sides of pairs: the side that is at zero stays there.

    Where both sides are, each may leave zero, so that what no step mends then is not mended on any branch either.

    Parameters
    ----------
    model : Block
        With the values of the point in question.
    pairs : iterable of CanonicalPair
        Those of which only parts of the sides belong to the pair are left out.
    """
    found = []
    for row in model.component_data_objects(Constraint, active=True, descend_into=Block):
        lower, body, upper = row.to_bounded_expression(True)
        if any(True for _ in variables_in(body, include_fixed=False)):
            found.append(StatedRow(row, body, lower, upper))
    for pair in pairs:
        if pair.a_part is SidePart.WHOLE is pair.b_part:
            sides = [number_or_nan(side) for side in (pair.a, pair.b)]
            at_zero = None if max(sides) <= _BIACTIVE else int(sides[1] < sides[0])
            for number, side in enumerate((pair.a, pair.b)):
                found.append(StatedRow(pair.source, side, 0.0, 0.0 if number == at_zero else None))
    return found


class ViolatedRows:
    """Rows at the values that are on the model.

    Parameters
    ----------
    rows : sequence of StatedRow
    weights : float array, shape (m,), optional
        Of the rows' violations; by default such that moving one variable by its size changes a row by at most one.

    Attributes
    ----------
    weights : float array, shape (m,)
    total : float
        Weighted violation of all rows, in sum.
    is_finite : bool
        Whether all rows have a value and derivatives.
    """

    def __init__(self, rows: Sequence[StatedRow], weights: FloatArray | None = None) -> None:
        self._rows = rows
        self._variables: list[Any] = []
        self._matrix = self._slopes()
        self._x = np.array([variable.value for variable in self._variables], dtype=float)
        bounds = np.array([variable.bounds for variable in self._variables], dtype=float).reshape(-1, 2)
        self._lower = np.where(np.isnan(bounds[:, 0]), -np.inf, bounds[:, 0])
        self._upper = np.where(np.isnan(bounds[:, 1]), np.inf, bounds[:, 1])
        width = self._upper - self._lower
        self._sizes = np.maximum(np.maximum(1.0, np.abs(self._x)), np.where(np.isfinite(width), width, 0.0))
        values = np.array([number_or_nan(row.body) for row in rows])
        values[np.isinf(values)] = np.nan
        # From each row's value down to its lower and up to its upper bound.
        self._to_lower = np.array([-np.inf if row.lower is None else row.lower for row in rows]) - values
        self._to_upper = np.array([np.inf if row.upper is None else row.upper for row in rows]) - values
        self.is_finite = bool(np.isfinite(values).all() and np.isfinite(self._matrix.data).all())
        self.weights = self._own_weights() if weights is None else weights
        self.total = float(self.weights @ (np.maximum(self._to_lower, 0.0) + np.maximum(-self._to_upper, 0.0)))

    def _slopes(self) -> Any:
        """The Jacobian of the rows by the variables that may move, which are listed on the way."""
        columns: dict[int, int] = {}
        entries: list[tuple[int, int, float]] = []
        for number, row in enumerate(self._rows):
            for variable, slope in gradient(row.body, variables_in(row.body, include_fixed=False)):
                column = columns.setdefault(id(variable), len(columns))
                if column == len(self._variables):
                    self._variables.append(variable)
                entries.append((number, column, slope))
        i, j, slopes = np.array(entries, dtype=float).reshape(-1, 3).T
        return scipy.sparse.csr_array((slopes, (i.astype(int), j.astype(int))), shape=(len(self._rows), len(columns)))

    def _own_weights(self) -> FloatArray:
        sized = abs(self._matrix @ scipy.sparse.diags(self._sizes)).tocoo()
        slopes = np.zeros(len(self._rows))
        np.fmax.at(slopes, sized.row, sized.data)
        return 1.0 / np.where(slopes > 0, slopes, 1.0)

    def step(self, radius: float, deadline: Deadline) -> LinearStep | None:
        """The step within the bounds and a trust region, in sizes, after which the rows are violated least."""
        m, n = self._matrix.shape
        reach = radius * self._sizes if np.isfinite(radius) else np.full(n, np.inf)
        unit = scipy.sparse.identity(m, format="csr")
        below, above = np.isfinite(self._to_lower), np.isfinite(self._to_upper)
        program = LinearProgram(
            np.concatenate([np.zeros(n), self.weights, self.weights]),
            np.concatenate([np.maximum(self._lower - self._x, -reach), np.zeros(2 * m)]),
            np.concatenate(
                [np.minimum(self._upper - self._x, reach), np.where(below, np.inf, 0.0), np.where(above, np.inf, 0.0)]
            ),
            [(scipy.sparse.hstack([self._matrix, unit, -unit], format="csr"), self._to_lower, self._to_upper)],
        )
        answer = program.solve_with_duals(deadline.within(_LONGEST))
        if answer is None:
            return None
        point, multipliers = answer
        length = float(np.abs(point[:n] / self._sizes).max(initial=0.0))
        return LinearStep(point[:n], length, float(program.cost @ point), multipliers)

    def least_widening(self, parts: Iterable[Any], deadline: Deadline) -> float | None:
        """By how much bounds of some variables, or sides of some rows, have to give way for linear rows to be met.

        Parameters
        ----------
        parts : iterable of component data
        deadline : Deadline

        Returns
        -------
        float or None
            Infinite where that is not enough; None where the linear program did not end.
        """
        n = self._matrix.shape[1]
        giving = set(map(id, parts))
        moved = np.array([id(variable) in giving for variable in self._variables], dtype=bool)
        yielding = np.array([[float(id(row.data) in giving)] for row in self._rows])
        to_lower, to_upper = self._lower - self._x, self._upper - self._x
        of_moved = scipy.sparse.identity(n, format="csr")[np.flatnonzero(moved)]
        ones = np.ones((of_moved.shape[0], 1))
        rows = [
            (scipy.sparse.hstack([matrix, sign * column], format="csr"), *sides)
            for matrix, column, lower, upper in (
                (self._matrix, yielding, self._to_lower, self._to_upper),
                (of_moved, ones, to_lower[moved], to_upper[moved]),
            )
            for sign, sides in ((1.0, (lower, np.inf)), (-1.0, (-np.inf, upper)))
        ]
        program = LinearProgram(
            np.append(np.zeros(n), 1.0),
            np.append(np.where(moved, -np.inf, to_lower), 0.0),
            np.append(np.where(moved, np.inf, to_upper), np.inf),
            rows,
        )
        answer = program.solve(deadline.within(_LONGEST))
        if answer.status is LinearStatus.INFEASIBLE:
            return float("inf")
        return None if answer.x is None else float(answer.x[-1])

    def put(self, step: LinearStep | None = None) -> None:
        """Write the values to the model, after a step where there is one."""
        x = self._x if step is None else np.clip(self._x + step.change, self._lower, self._upper)
        put_values(self._variables, x.tolist())

    def obstructing(self, step: LinearStep) -> Iterator[ObstructingData]:
        """What has a multiplier: bounds, rows, and values that are fixed."""
        x, multipliers = self._x + step.change, step.row_multipliers
        sides = {id(row.body) for row in self._rows if row.data.parent_component().ctype in PAIR_TYPES}
        reduced = -(self._matrix.T @ multipliers)
        for j in np.flatnonzero(np.abs(reduced) * self._sizes > _NO_MULTIPLIER):
            bound, sign = (self._lower[j], ">=") if reduced[j] > 0 else (self._upper[j], "<=")
            of_pair = sign == ">=" and bound == 0.0 and id(self._variables[j]) in sides
            if abs(x[j] - bound) <= _AT_BOUND * self._sizes[j] and not of_pair:
                yield ObstructingData(self._variables[j], sign, float(bound), float(abs(reduced[j]) * self._sizes[j]))
        fixed: dict[int, tuple[Any, float]] = {}
        for i in np.flatnonzero(np.abs(multipliers) > _NO_MULTIPLIER * self.weights).tolist():
            row = self._rows[i]
            yield ObstructingData(row.data, "", 0.0, float(abs(multipliers[i]) / self.weights[i]))
            for variable, slope in gradient(row.body, [v for v in variables_in(row.body) if v.fixed]):
                if np.isfinite(slope):
                    of_others = fixed.get(id(variable), (variable, 0.0))[1]
                    fixed[id(variable)] = variable, of_others + slope * multipliers[i]
        for variable, slope in fixed.values():
            influence = abs(slope) * max(1.0, abs(variable.value))
            if influence > _NO_MULTIPLIER:
                yield ObstructingData(variable, "=", float(variable.value), float(influence))
