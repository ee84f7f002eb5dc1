"""What Ipopt needs to know of a problem: numbers in, numbers out.

The solver stack sees every problem through this protocol, so that the origin of the derivatives (ASL, CasADi,
one's own code) is exchangeable and can be wrapped, as `ShiftedRows` does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.optional_imports import scipy

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int32]


class NonlinearProgram(Protocol):
    """Minimise f(x) subject to g_lower <= g(x) <= g_upper and x_lower <= x <= x_upper.

    Always a minimisation: an evaluator of a maximised objective returns its negative. Every method returns a
    fresh array (or one that nobody else writes to) and raises `EvaluationError`, and nothing else, where a value or
    a derivative does not exist or is not finite. The arrays that a method receives may be Ipopt's own memory: copy
    what is kept beyond the call.

    Attributes
    ----------
    derivatives : str
        Where the derivatives come from, for people to read: ``"ASL through PyNumero"``.
    n, m : int
        Numbers of variables and of rows.
    x_lower, x_upper : float array, shape (n,)
        Bounds of the variables, infinite where there is none.
    g_lower, g_upper : float array, shape (m,)
        Bounds of the rows, infinite where there is none; equal for an equation.
    x_start : float array, shape (n,)
        First point.
    g_multipliers_start : float array, shape (m,), or None
        First multipliers of the rows in Ipopt's sign (the Lagrangian is f + multipliers @ g).
    jacobian_structure : pair of int32 arrays
        Rows and columns of the values that `jacobian` returns.
    hessian_structure : pair of int32 arrays
        Rows and columns of the values that `hessian` returns, each in the lower triangle (row >= column).
    """

    derivatives: str
    n: int
    m: int
    x_lower: FloatArray
    x_upper: FloatArray
    g_lower: FloatArray
    g_upper: FloatArray
    x_start: FloatArray
    g_multipliers_start: FloatArray | None
    jacobian_structure: tuple[IndexArray, IndexArray]
    hessian_structure: tuple[IndexArray, IndexArray]

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        ...

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f, shape (n,)."""
        ...

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g, shape (m,)."""
        ...

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g in the order of `jacobian_structure`."""
        ...

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of objective_factor * f + multipliers @ g in the order of `hessian_structure`."""
        ...


def finite(values: FloatArray, derivatives: str, label: str) -> FloatArray:
    """Values as they are.

    Raises
    ------
    EvaluationError
        When one of them is not finite.
    """
    if not np.isfinite(values).all():
        raise EvaluationError(f"{derivatives} cannot evaluate the {label} at this point: a value is not finite.")
    return values


@dataclass(frozen=True, eq=False)
class PrimalDualPoint:
    """A point of a nonlinear program with multipliers: where a run starts, and where it ends.

    With the Lagrangian f + g_multipliers @ g - lower_multipliers @ x + upper_multipliers @ x, those of bounds are not
    negative, and one of a row is positive when its upper bound holds it back.

    Attributes
    ----------
    x : float array, shape (n,)
    g_multipliers : float array, shape (m,), or None
        None where they are not known, as those of the bounds below.
    lower_multipliers, upper_multipliers : float array, shape (n,), or None
    """

    x: FloatArray
    g_multipliers: FloatArray | None = None
    lower_multipliers: FloatArray | None = None
    upper_multipliers: FloatArray | None = None

    def with_objective_divided(self, by: float) -> PrimalDualPoint:
        """The same point of the program whose objective is divided by a number: so are its multipliers."""
        rows, lower, upper = self.g_multipliers, self.lower_multipliers, self.upper_multipliers
        return PrimalDualPoint(self.x, *(None if known is None else known / by for known in (rows, lower, upper)))

    def complete(self, nlp: NonlinearProgram) -> tuple[FloatArray, FloatArray, FloatArray]:
        """All multipliers: rows, lower and upper bounds; by default 0 (or ``nlp.g_multipliers_start``), 1 and 1."""
        rows = self.g_multipliers
        if rows is None:
            rows = np.zeros(nlp.m) if nlp.g_multipliers_start is None else nlp.g_multipliers_start
        lower = np.ones(nlp.n) if self.lower_multipliers is None else self.lower_multipliers
        upper = np.ones(nlp.n) if self.upper_multipliers is None else self.upper_multipliers
        return rows, lower, upper


class WrappedProgram:
    """A nonlinear program made from another one, with its objective; a subclass replaces what differs.

    Parameters
    ----------
    nlp : NonlinearProgram
    """

    def __init__(self, nlp: NonlinearProgram) -> None:
        self.nlp = nlp
        self.derivatives = nlp.derivatives
        self.n, self.m = nlp.n, nlp.m
        self.x_lower, self.x_upper = nlp.x_lower, nlp.x_upper
        self.g_lower, self.g_upper = nlp.g_lower, nlp.g_upper
        self.x_start, self.g_multipliers_start = nlp.x_start, nlp.g_multipliers_start
        self.jacobian_structure, self.hessian_structure = nlp.jacobian_structure, nlp.hessian_structure
        # Forwarded as they are: one call less per evaluation.
        self.objective, self.gradient = nlp.objective, nlp.gradient


class ShiftedRows(WrappedProgram):
    """A nonlinear program whose marked rows are moved by a number that may change during a solve.

    A relaxed complementarity row was written with the bound `base`, as ``a*b - base <= 0`` or as
    ``a*b <= base``. Ipopt sees ``a*b - delta <= 0`` instead, with `delta` read at each evaluation. A shift leaves
    the Jacobian and the Hessian as they are, so delta can follow the barrier parameter at no cost.

    Parameters
    ----------
    nlp : NonlinearProgram
        The program with the bounds `base`.
    rows : int array
        Numbers of the rows to shift.
    base : float or float array of the shape of `rows`
        The bound that those rows were written with.

    Attributes
    ----------
    delta : float or float array of the shape of `rows`
        The bound that the solver sees from the next evaluation on; first the largest of `base`.
    """

    def __init__(self, nlp: NonlinearProgram, rows: ArrayLike, base: ArrayLike) -> None:
        super().__init__(nlp)
        self.rows = np.asarray(rows, dtype=np.intp)
        self.base = np.broadcast_to(np.asarray(base, dtype=float), self.rows.shape)
        outside = self.rows[(self.rows < 0) | (self.rows >= nlp.m)]
        if outside.size:
            raise IndexError(
                f"row {outside[0]} cannot be shifted: the program has {nlp.m} rows, numbered from 0. "
                "Take the numbers from CompiledModel.row_of."
            )
        self.delta: float | FloatArray = float(self.base.max(initial=0.0))
        self.jacobian, self.hessian = nlp.jacobian, nlp.hessian

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g, the marked rows moved by base - delta."""
        values = self.nlp.constraints(x).copy()
        # Not an in-place sum per entry of `rows`: a row that is named twice is still moved once.
        values[self.rows] = values[self.rows] + (self.base - self.delta)
        return values


def missing_rank(nlp: NonlinearProgram, x: FloatArray) -> int:
    """Equations less the structural rank of their Jacobian at a point; 0 where it has no derivatives there.

    The first step of Newton's method is not determined where there are any. A typical cause is an initial guess at
    rest: where a speed is zero, the direction of motion changes nothing.

    Parameters
    ----------
    nlp : NonlinearProgram
    x : float array, shape (n,)

    References
    ----------
    Pothen & Fan, Computing the block triangular form of a sparse matrix, ACM Trans. Math. Softw. 16 (1990), 303-324,
    doi:10.1145/98267.98287
    """
    rows, columns = nlp.jacobian_structure
    try:
        slopes = nlp.jacobian(x)
    except EvaluationError:
        return 0
    equations = nlp.g_lower == nlp.g_upper
    chosen = equations[rows] & (slopes != 0)
    matrix = scipy.sparse.csr_array((slopes[chosen], (rows[chosen], columns[chosen])), shape=(nlp.m, nlp.n))
    return int(equations.sum()) - int(scipy.sparse.csgraph.structural_rank(matrix))
