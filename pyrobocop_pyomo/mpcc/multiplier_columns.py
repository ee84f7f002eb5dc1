"""The unknowns of the stationarity conditions: multipliers of active rows, active bounds and zero sides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pyrobocop_pyomo.numerics import BoolArray
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .linearisation import Linearisation
from .problem import ComplementarityProgram, Sides

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class ColumnBlock:
    """Columns of unknowns in the gradient of the Lagrangian, their least and largest values, and their weights."""

    columns: csr_array
    least: FloatArray
    most: FloatArray
    weight: FloatArray


@dataclass(frozen=True, eq=False)
class Activity:
    """Which bounds of some values are active, and how far away they are."""

    at_lower: BoolArray
    at_upper: BoolArray
    to_lower: FloatArray
    to_upper: FloatArray

    @classmethod
    def of(cls, values: FloatArray, lower: FloatArray, upper: FloatArray, tolerance: float) -> Activity:
        """Compare values with their bounds."""
        to_lower, to_upper = np.abs(values - lower), np.abs(upper - values)
        return cls(to_lower <= tolerance, to_upper <= tolerance, to_lower, to_upper)

    @property
    def active(self) -> BoolArray:
        """Where either bound is active."""
        return self.at_lower | self.at_upper

    def block(self, columns: csr_array) -> ColumnBlock:
        """The unknowns of the active ones: positive multipliers at upper bounds, negative ones at lower bounds."""
        active, one_sided = self.active, self.at_lower ^ self.at_upper
        distance = np.where(one_sided, np.where(self.at_lower, self.to_lower, self.to_upper), 0.0)
        least, most = np.where(self.at_lower, -np.inf, 0.0), np.where(self.at_upper, np.inf, 0.0)
        return ColumnBlock(columns, least[active], most[active], distance[active])


def row_activity(
    program: ComplementarityProgram, point: Linearisation, zero_pairs: tuple[np.ndarray, np.ndarray], tolerance: float
) -> Activity:
    """Which rows may have a multiplier of their own."""
    found = Activity.of(point.rows, point.nlp.g_lower, point.nlp.g_upper, tolerance)
    # A row that only says that a zero side is nonnegative has no multiplier of its own: it is the pair's nu or xi.
    for at_bound, rows in zip((found.at_lower, found.at_upper), rows_of_sides(program, point, zero_pairs), strict=True):
        at_bound[rows] = False
    return found


def rows_of_sides(
    program: ComplementarityProgram, point: Linearisation, zero_pairs: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Rows whose lower, and rows whose upper bound only says that a zero side is nonnegative."""
    jacobian = point.jacobian.copy()
    jacobian.eliminate_zeros()  # entries that are zero at this point do not count in first derivatives
    single = np.flatnonzero(np.diff(jacobian.indptr) == 1)
    column, slope = jacobian.indices[jacobian.indptr[single]], jacobian.data[jacobian.indptr[single]]
    at_lower, at_upper = np.zeros(single.size, dtype=bool), np.zeros(single.size, dtype=bool)
    for sides, pairs in zip((program.a, program.b), zero_pairs, strict=True):
        for sign in (1.0, -1.0):
            of_side = np.isin(column, sides.index[pairs[sides.sign[pairs] == sign]])
            at_lower |= of_side & (sign * slope > 0)
            at_upper |= of_side & (sign * slope < 0)
    return single[at_lower], single[at_upper]


def active_rows(point: Linearisation, activity: Activity) -> ColumnBlock:
    """Columns of the active rows."""
    return activity.block(point.jacobian[np.flatnonzero(activity.active)].T.tocsr())


def active_bounds(
    program: ComplementarityProgram, point: Linearisation, zero_pairs: tuple[np.ndarray, np.ndarray], tolerance: float
) -> ColumnBlock:
    """Columns of the active bounds, except those that only keep a zero side nonnegative."""
    nlp = point.nlp
    found = Activity.of(point.x, nlp.x_lower, nlp.x_upper, tolerance)
    # The bound that makes a zero side nonnegative is the pair's own as well.
    for sides, pairs in zip((program.a, program.b), zero_pairs, strict=True):
        index, rising = sides.index[pairs], sides.sign[pairs] > 0
        found.at_lower[index[rising]] = False
        found.at_upper[index[~rising]] = False
    active = np.flatnonzero(found.active)
    return found.block(_unit_columns(active, np.ones(active.size), nlp.n))


def side_columns(sides: Sides, pairs: np.ndarray, n: int) -> ColumnBlock:
    """Columns of the multipliers of zero sides, of any sign."""
    columns = _unit_columns(sides.index[pairs], -sides.sign[pairs], n)
    free = np.full(pairs.size, np.inf)
    return ColumnBlock(columns, -free, free, np.zeros(pairs.size))


def _unit_columns(rows: np.ndarray, values: FloatArray, n: int) -> csr_array:
    return scipy.sparse.csr_array((values, (rows, np.arange(rows.size))), shape=(n, rows.size))
