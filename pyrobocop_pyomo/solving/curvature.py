"""What second derivatives say: whether a stationary point is no minimum, and whether a program is convex.

A point is no minimum where the curvature of the Lagrangian is negative along what the active rows leave free. Where
rows are linear and the objective is a convex quadratic, no other start leads to a better optimum.
"""

from __future__ import annotations

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.ipopt.linear_solvers import suits
from pyrobocop_pyomo.linear_solver import SymmetricFactorisation
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint

NEAR = 1e-4  # a row or bound at most this far away may be active
# A step of size one in the variables has to promise so much, of the objective. Arcs that are singular, and directions
# that change nothing, have no curvature but rounding.
LEAST_DECREASE = 1e-4
# On the rows' part of the diagonal, relative to the Hessian, so that rows that depend on each other do not matter.
_ROWS = -1e-8
_HALVINGS, _INVERSE_STEPS = 4, 20


def direction_of_descent(nlp: NonlinearProgram, point: PrimalDualPoint) -> FloatArray | None:
    r"""A direction along which the objective falls to second order, at a point that is stationary.

    With the Hessian of the Lagrangian :math:`W` and the Jacobian :math:`A` of the active rows, both for the variables
    that are away from their bounds, the matrix

    .. math:: \begin{pmatrix} W + \sigma I & A^T \\ A & -\delta I \end{pmatrix}

    has one negative eigenvalue for each row exactly where :math:`W + \sigma I + A^T A / \delta` is positive definite
    (Gould 1985, doi:10.1007/BF01585660).

    Parameters
    ----------
    nlp : NonlinearProgram
        In variables, rows and an objective of size one.
    point : PrimalDualPoint

    Returns
    -------
    float array, shape (n,), or None
        Its largest entry is 1 in size. None where there is no such direction, where the program does not suit the
        linear solver of this package, or that solver is missing.

    Raises
    ------
    EvaluationError
        When a derivative does not exist at the point, or the matrix cannot be factored.
    """
    if not suits(nlp):
        return None
    x, (rows, lower, upper) = point.x, point.complete(nlp)
    g = nlp.constraints(x)
    # Bounds that are as near, or nearer than their multiplier is large, count as active: a direction then leaves none
    # of them, and may be taken in both of its senses.
    free = np.minimum(x - nlp.x_lower - lower, nlp.x_upper - x - upper) > NEAR
    active = np.minimum(g - nlp.g_lower, nlp.g_upper - g) <= NEAR + np.abs(rows)
    if not free.any():
        return None
    system = _System(nlp, x, rows, free, active)
    least = LEAST_DECREASE * max(1.0, abs(nlp.objective(x)))
    direction = system.most_negative(2.0 * least / free.sum())
    if direction is None or -0.5 * system.curvature(direction) < least:
        return None
    full = np.zeros(nlp.n)
    full[free] = direction
    return full


class _System:
    """The matrix of first-order conditions at a point, without the variables that are at bounds."""

    def __init__(
        self, nlp: NonlinearProgram, x: FloatArray, multipliers: FloatArray, free: np.ndarray, active: np.ndarray
    ) -> None:
        self.n, self.m = int(free.sum()), int(active.sum())
        number, row_number = np.cumsum(free) - 1, np.cumsum(active) - 1 + self.n
        rows, columns = nlp.hessian_structure
        kept = free[rows] & free[columns]
        self._rows, self._columns = number[rows[kept]], number[columns[kept]]
        self._hessian = nlp.hessian(x, 1.0, multipliers)[kept]
        rows, columns = nlp.jacobian_structure
        kept = active[rows] & free[columns]
        diagonal = np.arange(self.n + self.m)
        self._factors = SymmetricFactorisation(
            self.n + self.m,
            np.concatenate([self._rows, row_number[rows[kept]], diagonal]),
            np.concatenate([self._columns, number[columns[kept]], diagonal]),
        )
        # With dependent rows multipliers may be huge, and the Hessian with them: beside it the rows must not give way.
        self._size = max(1.0, float(np.abs(self._hessian).max(initial=0.0)))
        self._off_diagonal = np.concatenate([self._hessian / self._size, nlp.jacobian(x)[kept]])

    def curvature(self, direction: FloatArray) -> float:
        """Of the Lagrangian along a direction."""
        terms = self._hessian * direction[self._rows] * direction[self._columns]
        return float(np.where(self._rows == self._columns, terms, 2.0 * terms).sum())

    def most_negative(self, shift: float) -> FloatArray | None:
        """The direction of the most negative curvature; None where all are above minus the shift."""
        if self.is_convex(shift):
            return None
        below, shift = shift, 10.0 * shift
        while not self.is_convex(shift) and shift < self._size * self.n:
            below, shift = shift, 10.0 * shift
        for _ in range(_HALVINGS):
            middle = (below * shift) ** 0.5
            below, shift = (below, middle) if self.is_convex(middle) else (middle, shift)
        if not self.is_convex(shift):
            return None
        direction = np.random.default_rng(0).standard_normal(self.n)
        for _ in range(_INVERSE_STEPS):
            direction = self._factors.solve(np.concatenate([direction, np.zeros(self.m)]))[: self.n]
            direction /= np.abs(direction).max()
        return direction

    def is_convex(self, shift: float) -> bool:
        """Whether no curvature is below minus the shift; the factors are kept."""
        diagonal = np.concatenate([np.full(self.n, shift / self._size), np.full(self.m, _ROWS)])
        return self._factors.factor(np.concatenate([self._off_diagonal, diagonal])).negative == self.m


def is_convex(nlp: NonlinearProgram, x: FloatArray) -> bool:
    """Whether second derivatives say so at a point and at a random one beside it.

    Derivatives that are constant agree at any two points; others differ at almost all.

    Parameters
    ----------
    nlp : NonlinearProgram
    x : float array, shape (n,)
        A point at which all functions have values.
    """
    random = np.random.default_rng(0)
    beside = np.clip(x + np.maximum(1.0, np.abs(x)) * random.uniform(-0.5, 0.5, x.size), nlp.x_lower, nlp.x_upper)
    try:
        if any(nlp.hessian(at, 0.0, random.uniform(0.5, 1.0, nlp.m)).any() for at in (x, beside)):
            return False
        here, there = (nlp.hessian(at, 1.0, np.zeros(nlp.m)) for at in (x, beside))
        size = float(np.abs(here).max(initial=0.0))
        if not np.allclose(here, there, rtol=0.0, atol=NEGLIGIBLE * size):
            return False
        if size == 0.0:
            return True
        system = _System(nlp, x, np.zeros(nlp.m), np.full(nlp.n, True), np.full(nlp.m, False)) if suits(nlp) else None
        return system is not None and system.is_convex(NEGLIGIBLE * size)
    except EvaluationError:
        return False
