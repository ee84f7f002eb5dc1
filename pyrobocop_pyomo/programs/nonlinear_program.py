"""What Ipopt needs to know of a problem: numbers in, numbers out.

The solver stack sees every problem through this protocol, so that the origin of the derivatives (ASL, CasADi,
one's own code) is exchangeable and can be wrapped, as `ShiftedRows` does.

How far a point with multipliers is from stationary, whatever units the program is in.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.numerics.characteristic_scales import objective_scale
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


def scattered(count: int) -> FloatArray:
    """Numbers from 0 to 1 of which no few are in proportion: multiples of the golden ratio, less their whole parts."""
    return np.asarray(np.arange(1, count + 1) * ((np.sqrt(5.0) - 1.0) / 2.0) % 1.0)


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

    def with_multipliers_divided(self, rows: FloatArray | float, bounds: FloatArray | float) -> PrimalDualPoint:
        """The same point with its multipliers, as far as they are known, divided by these numbers."""
        known = (self.g_multipliers, rows), (self.lower_multipliers, bounds), (self.upper_multipliers, bounds)
        return PrimalDualPoint(self.x, *(None if values is None else values / by for values, by in known))

    def with_objective_divided(self, by: float) -> PrimalDualPoint:
        """The same point of the program whose objective is divided by a number: so are its multipliers."""
        return self.with_multipliers_divided(by, by)

    def complete(self, nlp: NonlinearProgram) -> tuple[FloatArray, FloatArray, FloatArray]:
        """All multipliers: rows, lower and upper bounds; by default 0, 1 and 1."""
        rows = np.zeros(nlp.m) if self.g_multipliers is None else self.g_multipliers
        lower = np.ones(nlp.n) if self.lower_multipliers is None else self.lower_multipliers
        upper = np.ones(nlp.n) if self.upper_multipliers is None else self.upper_multipliers
        return rows, lower, upper


class ProblemScaling(NamedTuple):
    """Factors for the objective, the variables and the rows."""

    objective: float
    x: FloatArray
    g: FloatArray


@dataclass(frozen=True, eq=False)
class Scales:
    r"""Sizes that variables, rows and the objective are divided by.

    With :math:`x = S \hat x`, :math:`g = R \hat g` and :math:`f = \varphi \hat f`, the multipliers of the rows are
    :math:`\lambda = \varphi R^{-1} \hat\lambda`, those of bounds :math:`z = \varphi S^{-1} \hat z`.

    Attributes
    ----------
    x : float array, shape (n,)
    g : float array, shape (m,)
    objective : float
    """

    x: FloatArray
    g: FloatArray
    objective: float

    def scaled(self, point: PrimalDualPoint) -> PrimalDualPoint:
        """A point of the program as one of the scaled program."""
        x = point.x / self.x
        return replace(point.with_multipliers_divided(self.objective / self.g, self.objective / self.x), x=x)

    def unscaled(self, point: PrimalDualPoint, nlp: NonlinearProgram) -> PrimalDualPoint:
        """A point of the scaled program as one of the program `nlp`, within its bounds.

        What is on a bound stays there, and what Ipopt lets pass it, by parts of a size, is put there: a bound at zero
        has no size in the units of the user.
        """
        x = np.clip(self.x * point.x, nlp.x_lower, nlp.x_upper)
        for bound in (nlp.x_lower, nlp.x_upper):
            held = np.isfinite(bound) & (np.abs(x - bound) <= 4 * np.finfo(float).eps * np.abs(x))
            x = np.where(held, bound, x)
        return replace(point.with_multipliers_divided(self.g / self.objective, self.x / self.objective), x=x)


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


# --------------------------------------------------------------------------------------------------------- stationarity


# Derivatives at a point may be zero by chance, as those of an objective at its minimum: they are taken about a tenth of
# each size beside it as well.
_STEP = 0.1
# Of the change of the objective by all variables: what is less tells nothing beside the rounding of all the rest.
_LEAST_SHARE = 1e-4


def stationarity(nlp: NonlinearProgram, point: PrimalDualPoint, sizes: FloatArray) -> float:
    r"""What first-order conditions leave, relative to the largest of the terms that have to balance.

    With the terms :math:`\partial f / \partial x_j`, :math:`\lambda_i \partial g_i / \partial x_j` and
    :math:`z_j` of the Lagrangian's derivative by a variable, at the point and a tenth of the sizes :math:`s` beside it,
    :math:`w_j` is :math:`s_j` times the largest. Compared with it are :math:`s_j` times the sum of these terms, and the
    multipliers of bounds and of rows times the distances from these. So nothing changes where the objective, a row or a
    variable is measured in another unit.

    Parameters
    ----------
    nlp : NonlinearProgram
    point : PrimalDualPoint
    sizes : float array, shape (n,)
        Of the variables at the point.

    Raises
    ------
    EvaluationError
        When a derivative does not exist at the point, or the multipliers are not finite.
    """
    multipliers, lower, upper = point.complete(nlp)
    rows, columns = nlp.jacobian_structure
    free = nlp.x_lower < nlp.x_upper
    gradients, jacobians = [nlp.gradient(point.x)], [nlp.jacobian(point.x)]
    x = beside(nlp, point.x, sizes)
    with contextlib.suppress(EvaluationError):  # what is known at the point has to do
        gradients, jacobians = [*gradients, nlp.gradient(x)], [*jacobians, nlp.jacobian(x)]
    with np.errstate(all="ignore"):  # what overflows is noticed in the result
        residual = gradients[0] - lower + upper
        np.add.at(residual, columns, jacobians[0] * multipliers[rows])
        terms = np.maximum(np.abs(lower), np.abs(upper))
        for gradient, jacobian in zip(gradients, jacobians, strict=True):
            terms = np.maximum(terms, np.abs(gradient))
            np.maximum.at(terms, columns, np.abs(jacobian * multipliers[rows]))
        weights = np.maximum(terms * sizes, _LEAST_SHARE * objective_scale(np.array(gradients), sizes))
        of_bounds = np.abs(lower) * np.minimum(point.x - nlp.x_lower, sizes)
        of_bounds = np.maximum(of_bounds, np.abs(upper) * np.minimum(nlp.x_upper - point.x, sizes))
        found = (np.maximum(np.abs(residual) * sizes, of_bounds) / weights)[free]
        values = nlp.constraints(point.x)
        reach, weight = np.zeros(nlp.m), np.zeros(nlp.m)
        np.maximum.at(reach, rows, np.abs(jacobians[0]) * sizes[columns])
        np.maximum.at(weight, rows, weights[columns])
        slack = np.where(multipliers > 0.0, nlp.g_upper - values, values - nlp.g_lower)
        there = weight > 0.0
        of_rows = np.abs(multipliers[there]) * np.minimum(np.abs(slack), reach)[there] / weight[there]
        found = finite(np.concatenate([found, of_rows]), nlp.derivatives, "gradient of the Lagrangian")
    return float(found.max(initial=0.0))


def beside(nlp: NonlinearProgram, x: FloatArray, sizes: FloatArray) -> FloatArray:
    """A point about a tenth of each size away, within the bounds; every variable goes its own way."""
    steps = _STEP * sizes * (0.5 + scattered(nlp.n))
    up = x + steps
    return np.clip(np.where(up <= nlp.x_upper, up, x - steps), nlp.x_lower, nlp.x_upper)
