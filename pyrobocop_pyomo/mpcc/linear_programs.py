"""Linear programs whose bounds change from solve to solve, in one HiGHS object for all of them."""

from __future__ import annotations

import enum
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pyrobocop_pyomo.optional_imports import highs_bindings, scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Bounds that cross by less are equal, but for rounding.
CROSSED_BOUNDS = 1e-9

Rows = tuple[Any, FloatArray | float, FloatArray | float]


class LinearStatus(enum.Enum):
    """How a linear program ended; the value is a sentence."""

    SOLVED = "Solved: the point is an optimum, to the solver's tolerances."
    INFEASIBLE = "Infeasible: no point meets the rows and bounds."
    STOPPED = "Stopped by a limit, unbounded, or not solvable to the solver's tolerances."


class LinearProgram:
    """Minimise ``cost @ x`` over rows and bounds.

    One HiGHS object per thread serves all programs, and a program whose bounds change goes on from the basis of its
    last solve. Where neither highspy nor SciPy gives access to such an object, each solve starts anew in SciPy.

    Parameters
    ----------
    cost, lower, upper : float array, shape (n,)
    constraints : sequence of (matrix, lower, upper)
        Rows ``lower <= matrix @ x <= upper``; a matrix without rows is left out.
    """

    def __init__(
        self, cost: FloatArray, lower: FloatArray, upper: FloatArray, constraints: Sequence[Rows] = ()
    ) -> None:
        some = [rows for rows in constraints if rows[0].shape[0]]
        self.cost, self.lower, self.upper = cost, lower, np.maximum(lower, upper)
        empty = scipy.sparse.csr_array((0, cost.size))
        self._matrix: csr_array = scipy.sparse.vstack([empty, *(rows[0] for rows in some)], format="csr")
        self._row_lower, self._row_upper = (
            np.concatenate([np.empty(0), *(np.broadcast_to(rows[side], rows[0].shape[0]) for rows in some)])
            for side in (1, 2)
        )

    @property
    def rows(self) -> tuple[csr_array, FloatArray, FloatArray]:
        """The matrix of all rows, and their bounds."""
        return self._matrix, self._row_lower, self._row_upper

    def solve(
        self, lower: FloatArray | None = None, upper: FloatArray | None = None, *, time_limit: float
    ) -> tuple[LinearStatus, FloatArray | None]:
        """Solve with these bounds, or with those of the program; the point is None unless it is an optimum.

        Parameters
        ----------
        lower, upper : float array, shape (n,), optional
        time_limit : float
            Seconds.
        """
        lower, upper = self.lower if lower is None else lower, self.upper if upper is None else upper
        if (lower > upper + CROSSED_BOUNDS).any():
            return LinearStatus.INFEASIBLE, None
        upper = np.maximum(lower, upper)
        if not self.cost.size:
            return LinearStatus.SOLVED, np.empty(0)
        solver = _kept_solver()
        if solver is None:
            return self._solved_anew(lower, upper, time_limit)
        return solver.solve(self, lower, upper, time_limit)

    def row_duals(self, *, time_limit: float) -> FloatArray | None:
        """By how much the least cost grows per unit of a row's active bound; None where HiGHS gives none."""
        solver = _kept_solver()
        if solver is None or self.solve(time_limit=time_limit)[0] is not LinearStatus.SOLVED:
            return None
        return solver.row_duals() if self.cost.size else np.zeros(self._row_lower.size)

    def _solved_anew(
        self, lower: FloatArray, upper: FloatArray, time_limit: float
    ) -> tuple[LinearStatus, FloatArray | None]:
        rows = scipy.optimize.LinearConstraint(self._matrix, self._row_lower, self._row_upper)
        result = scipy.optimize.milp(
            self.cost,
            bounds=scipy.optimize.Bounds(lower, upper),
            constraints=[rows] if self._row_lower.size else None,
            options={"time_limit": time_limit},
        )
        status = {0: LinearStatus.SOLVED, 2: LinearStatus.INFEASIBLE}.get(result.status, LinearStatus.STOPPED)
        return status, result.x if status is LinearStatus.SOLVED else None

    def model(self, bindings: Any, lower: FloatArray, upper: FloatArray) -> Any:
        """The program in the form that HiGHS reads."""
        model = bindings.HighsLp()
        model.num_col_, model.num_row_ = self.cost.size, self._row_lower.size
        model.col_cost_, model.col_lower_, model.col_upper_ = self.cost, lower, upper
        model.row_lower_, model.row_upper_ = self._row_lower, self._row_upper
        model.a_matrix_.format_ = bindings.MatrixFormat.kRowwise
        model.a_matrix_.start_ = self._matrix.indptr.astype(np.int32)
        model.a_matrix_.index_ = self._matrix.indices.astype(np.int32)
        model.a_matrix_.value_ = self._matrix.data
        return model


class _Highs:
    """A HiGHS object, and the program that it holds."""

    def __init__(self, bindings: Any) -> None:
        self._bindings = bindings
        self._highs = bindings._Highs()  # the class that highspy and SciPy both have
        self._highs.setOptionValue("output_flag", False)
        # Programs that take milliseconds gain nothing from more threads, which keep the other cores busy with waiting.
        self._highs.setOptionValue("threads", 1)
        self._program: LinearProgram | None = None
        self._lower = self._upper = np.empty(0)

    def solve(
        self, program: LinearProgram, lower: FloatArray, upper: FloatArray, time_limit: float
    ) -> tuple[LinearStatus, FloatArray | None]:
        highs, statuses = self._highs, self._bindings.HighsModelStatus
        self._put(program, lower, upper)
        # Its clock counts all runs of the object.
        highs.setOptionValue("time_limit", highs.getRunTime() + time_limit)
        # All objects of a thread share the threads of the first run, and one that asks for another number of them is
        # refused: those of the user's runs are given up before ours, and ours before the user's next.
        highs.resetGlobalScheduler(True)
        highs.run()
        highs.resetGlobalScheduler(True)
        status = highs.getModelStatus()
        if status == statuses.kOptimal:
            return LinearStatus.SOLVED, np.array(highs.getSolution().col_value)
        return (LinearStatus.INFEASIBLE if status == statuses.kInfeasible else LinearStatus.STOPPED), None

    def row_duals(self) -> FloatArray:
        return np.array(self._highs.getSolution().row_dual)

    def _put(self, program: LinearProgram, lower: FloatArray, upper: FloatArray) -> None:
        if self._program is program:
            changed = np.flatnonzero((lower != self._lower) | (upper != self._upper)).astype(np.int32)
            if changed.size:
                self._highs.changeColsBounds(changed.size, changed, lower[changed], upper[changed])
        else:
            self._program = None
            self._highs.passModel(program.model(self._bindings, lower, upper))
            self._program = program
        self._lower, self._upper = lower.copy(), upper.copy()


class _OfThread(threading.local):
    solver: _Highs | None = None


_of_thread = _OfThread()


def _kept_solver() -> _Highs | None:
    """The object of this thread; None where there is no way to have one."""
    bindings = highs_bindings()
    if _of_thread.solver is None and bindings is not None:
        _of_thread.solver = _Highs(bindings)
    return _of_thread.solver
