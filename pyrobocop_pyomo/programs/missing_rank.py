"""How many equations of a program cannot be met one by one at a point: their derivatives leave too few variables."""

from __future__ import annotations

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.optional_imports import scipy

from .nonlinear_program import FloatArray, NonlinearProgram


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
