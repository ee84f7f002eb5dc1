"""Linear programs, some with integers, by the HiGHS that SciPy brings."""

from __future__ import annotations

import enum
import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.optional_imports import scipy

from .arrays import Array, BoolArray
from .rounding import NEGLIGIBLE

Rows = tuple[Any, Array | float, Array | float]
Bounds = tuple[Array, Array]


class LinearStatus(enum.Enum):
    """How a linear program ended; the value is a sentence."""

    SOLVED = "Solved: the point is an optimum, to the solver's tolerances."
    INFEASIBLE = "Infeasible: no point meets the rows and bounds."
    STOPPED = "Stopped by a limit, unbounded, or not solvable to the solver's tolerances."


class LinearAnswer(NamedTuple):
    """How a linear program ended.

    Attributes
    ----------
    status : LinearStatus
    x : float array or None
        The optimum, or the best point with integers that was found before a limit; None where there is none.
    nodes : int
        Of the search tree; at least 1.
    duals : float array, shape (m,)
        By how much the least cost grows per unit of the active bound of each row; empty with integers, or without an
        optimum.
    """

    status: LinearStatus
    x: Array | None
    nodes: int = 1
    duals: Array = np.empty(0)


@dataclass(frozen=True, eq=False)
class LinearProgram:
    """Minimise ``cost @ x`` over rows and bounds.

    Attributes
    ----------
    cost, lower, upper : float array, shape (n,)
    rows : sequence of (matrix, lower, upper)
        ``lower <= matrix @ x <= upper``; a matrix without rows is left out.
    integer : bool array, shape (n,), optional
        Which variables are integers.
    """

    cost: Array
    lower: Array
    upper: Array
    rows: Sequence[Rows] = ()
    integer: BoolArray | None = None

    def with_binaries(self, count: int, rows: Sequence[Rows]) -> LinearProgram:
        """The program with so many binaries as further columns, and rows on all columns."""
        n = self.cost.size
        wider = [
            (scipy.sparse.hstack([matrix, scipy.sparse.csr_array((matrix.shape[0], count))], format="csr"), *sides)
            for matrix, *sides in self.rows
        ]
        return LinearProgram(
            np.concatenate([self.cost, np.zeros(count)]),
            np.concatenate([self.lower, np.zeros(count)]),
            np.concatenate([self.upper, np.ones(count)]),
            [*wider, *rows],
            np.arange(n + count) >= n,
        )

    def without_binaries(self, values: BoolArray) -> LinearProgram:
        """The program whose last columns, which are binaries, may take any values but these together."""
        others = np.concatenate([np.zeros(self.cost.size - values.size), np.where(values, -1.0, 1.0)])
        row = (scipy.sparse.csr_array(others[None]), 1.0 - values.sum(), np.inf)
        return replace(self, rows=[*self.rows, row])

    def solve(
        self, deadline: Deadline, node_limit: int | None = None, gap: float = 1e-6, bounds: Bounds | None = None
    ) -> LinearAnswer:
        """Solve it.

        Parameters
        ----------
        deadline : Deadline
        node_limit : int, optional
            Most nodes of the search tree: unlike seconds, the same on a busy machine.
        gap : float
            Relative distance from the optimum at which the search may stop.
        bounds : (lower, upper), optional
            Of the variables, in place of the program's own.
        """
        lower, upper = bounds or (self.lower, self.upper)
        if (lower > upper + NEGLIGIBLE).any():
            return LinearAnswer(LinearStatus.INFEASIBLE, None)
        if not self.cost.size:
            return LinearAnswer(LinearStatus.SOLVED, np.empty(0))
        upper = np.maximum(lower, upper)
        if self.integer is None:
            return self._solve_continuous(lower, upper, deadline)
        result = scipy.optimize.milp(
            self.cost,
            integrality=self.integer,
            bounds=scipy.optimize.Bounds(lower, upper),
            constraints=[scipy.optimize.LinearConstraint(*some) for some in self.rows if some[0].shape[0]],
            options={**_time_limit(deadline), "mip_rel_gap": gap, "node_limit": node_limit},
        )
        status = _STATUS.get(result.status, LinearStatus.STOPPED)
        return LinearAnswer(status, result.x, max(1, int(result.mip_node_count or 0)))

    @functools.cached_property
    def _rows_by_kind(self) -> tuple[Any, ...]:
        """The rows as `linprog` takes them, whatever the bounds; and which have equal, upper and lower sides."""
        columns = self.cost.size
        matrix = scipy.sparse.vstack([scipy.sparse.csr_array((0, columns)), *(some[0] for some in self.rows)], "csr")
        lower, upper = (
            np.concatenate([np.empty(0), *(np.broadcast_to(some[side], some[0].shape[0]) for some in self.rows)])
            for side in (1, 2)
        )
        equal = np.flatnonzero(lower == upper)
        above, below = (np.flatnonzero(np.isfinite(bound) & (lower != upper)) for bound in (upper, lower))
        rows = {
            "A_ub": scipy.sparse.vstack([matrix[above], -matrix[below]]),
            "b_ub": np.concatenate([upper[above], -lower[below]]),
            "A_eq": matrix[equal],
            "b_eq": lower[equal],
        }
        return rows, equal, above, below

    def _solve_continuous(self, lower: Array, upper: Array, deadline: Deadline) -> LinearAnswer:
        # `milp` would take programs without integers as well, but some of them ten times as long, or without an end.
        rows, equal, above, below = self._rows_by_kind
        result = scipy.optimize.linprog(
            self.cost, **rows, bounds=np.column_stack([lower, upper]), options=_time_limit(deadline)
        )
        status = _STATUS.get(result.status, LinearStatus.STOPPED)
        if status is not LinearStatus.SOLVED:
            return LinearAnswer(status, None)
        duals = np.zeros(sum(some[0].shape[0] for some in self.rows))
        duals[equal] = result.eqlin.marginals
        duals[above] += result.ineqlin.marginals[: above.size]
        duals[below] -= result.ineqlin.marginals[above.size :]
        return LinearAnswer(status, result.x, duals=duals)


_STATUS = {0: LinearStatus.SOLVED, 2: LinearStatus.INFEASIBLE}


def _time_limit(deadline: Deadline) -> dict[str, float]:
    return {} if deadline.left is None else {"time_limit": max(deadline.left, 0.0)}
