"""Linear programs, some with integers, by the HiGHS that SciPy brings."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.optional_imports import scipy

from .arrays import Array, BoolArray
from .rounding import NEGLIGIBLE

Rows = tuple[Any, Array | float, Array | float]


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
    """

    status: LinearStatus
    x: Array | None
    nodes: int = 1


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

    def solve(self, deadline: Deadline, node_limit: int | None = None, gap: float = 1e-6) -> LinearAnswer:
        """Solve it.

        Parameters
        ----------
        deadline : Deadline
        node_limit : int, optional
            Most nodes of the search tree: unlike seconds, the same on a busy machine.
        gap : float
            Relative distance from the optimum at which the search may stop.
        """
        if (self.lower > self.upper + NEGLIGIBLE).any():
            return LinearAnswer(LinearStatus.INFEASIBLE, None)
        if not self.cost.size:
            return LinearAnswer(LinearStatus.SOLVED, np.empty(0))
        rows = [scipy.optimize.LinearConstraint(*some) for some in self.rows if some[0].shape[0]]
        result = scipy.optimize.milp(
            self.cost,
            integrality=self.integer,
            bounds=scipy.optimize.Bounds(self.lower, np.maximum(self.lower, self.upper)),
            constraints=rows or None,
            options={**_time_limit(deadline), "mip_rel_gap": gap, "node_limit": node_limit},
        )
        status = {0: LinearStatus.SOLVED, 2: LinearStatus.INFEASIBLE}.get(result.status, LinearStatus.STOPPED)
        is_point = status is LinearStatus.SOLVED or self.integer is not None
        return LinearAnswer(status, result.x if is_point else None, max(1, int(result.mip_node_count or 0)))

    def solve_with_duals(self, deadline: Deadline) -> tuple[Array, Array] | None:
        """Solve it without integers.

        Returns
        -------
        float array, shape (n,)
            The optimum.
        float array, shape (m,)
            By how much the least cost grows per unit of the active bound of each row.
        """
        matrix = scipy.sparse.vstack([some[0] for some in self.rows], format="csr")
        lower, upper = (
            np.concatenate([np.broadcast_to(some[side], some[0].shape[0]) for some in self.rows]) for side in (1, 2)
        )
        equal = np.flatnonzero(lower == upper)
        above, below = (np.flatnonzero(np.isfinite(bound) & (lower != upper)) for bound in (upper, lower))
        result = scipy.optimize.linprog(
            self.cost,
            A_ub=scipy.sparse.vstack([matrix[above], -matrix[below]]),
            b_ub=np.concatenate([upper[above], -lower[below]]),
            A_eq=matrix[equal],
            b_eq=lower[equal],
            bounds=np.column_stack([self.lower, np.maximum(self.lower, self.upper)]),
            options=_time_limit(deadline),
        )
        if result.status != 0:
            return None
        duals = np.zeros(lower.size)
        duals[equal] = result.eqlin.marginals
        duals[above] += result.ineqlin.marginals[: above.size]
        duals[below] -= result.ineqlin.marginals[above.size :]
        return result.x, duals


def _time_limit(deadline: Deadline) -> dict[str, float]:
    return {} if deadline.left is None else {"time_limit": max(deadline.left, 0.0)}
