"""A nonlinear program whose rows may all be violated, at a price: the exact penalty of their violation."""

from __future__ import annotations

import numpy as np

from .nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint, WrappedProgram


class ElasticRows(WrappedProgram):
    r"""Minimise :math:`f(x) / \rho + \sum_i w_i (p_i + q_i)` with rows :math:`g(x) + p - q` and :math:`p, q \ge 0`.

    A row has a `p` where it has a lower bound and a `q` where it has an upper one. Any point can be completed to one
    that meets all rows, and the Jacobian has full rank whatever that of ``g`` is. Where the penalty :math:`\rho`
    exceeds all multipliers of a solution, that solution is one of this program too, with :math:`p = q = 0`.

    Parameters
    ----------
    nlp : NonlinearProgram
    penalty : float
        Of a unit of violation, in units of the objective.
    prices : float array, shape (m,), optional
        What violations of each row weigh: the reciprocals of their sizes; by default 1.

    References
    ----------
    Gill, Murray & Saunders, SNOPT: an SQP algorithm for large-scale constrained optimization, SIAM Review 47 (2005),
    sec. 4.6, doi:10.1137/S0036144504446096
    """

    def __init__(self, nlp: NonlinearProgram, penalty: float, prices: FloatArray | None = None) -> None:
        super().__init__(nlp)
        self.penalty = penalty
        self.objective, self.gradient = self._objective, self._gradient
        below, above = np.flatnonzero(np.isfinite(nlp.g_lower)), np.flatnonzero(np.isfinite(nlp.g_upper))
        self._below, self._above = below, above
        added = below.size + above.size
        weights = np.ones(nlp.m) if prices is None else prices
        self._weights = np.concatenate([weights[below], weights[above]])
        self.n = nlp.n + added
        self.x_lower = np.concatenate([nlp.x_lower, np.zeros(added)])
        self.x_upper = np.concatenate([nlp.x_upper, np.full(added, np.inf)])
        self.g_multipliers_start = None
        self.x_start = self.restrict(nlp.x_start)
        rows, columns = nlp.jacobian_structure
        self.jacobian_structure = (
            np.concatenate([rows, below, above]).astype(np.int32),
            np.concatenate([columns, nlp.n + np.arange(added)]).astype(np.int32),
        )
        self._signs = np.concatenate([np.ones(below.size), -np.ones(above.size)])

    def restrict(self, x: FloatArray) -> FloatArray:
        """A point of the program, completed by its violations; by zeros where its rows have no value."""
        try:
            g = self.nlp.constraints(x)
        except ArithmeticError:
            return np.concatenate([x, np.zeros(self._below.size + self._above.size)])
        short = np.maximum(self.g_lower[self._below] - g[self._below], 0.0)
        over = np.maximum(g[self._above] - self.g_upper[self._above], 0.0)
        return np.concatenate([x, short, over])

    def completed(self, of_variables: FloatArray, of_rows: FloatArray) -> FloatArray:
        """Numbers for all variables: the program's, and for each violation that of its row."""
        return np.concatenate([of_variables, of_rows[self._below], of_rows[self._above]])

    def at(self, x: FloatArray) -> FloatArray:
        """The point of the program behind a point of this one."""
        return x[: self.nlp.n]

    def multipliers(self, point: PrimalDualPoint) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Those of the program's rows and bounds: they differ by the factor of the objective."""
        rows, lower, upper = point.complete(self)
        n, penalty = self.nlp.n, self.penalty
        return penalty * rows, penalty * lower[:n], penalty * upper[:n]

    def _objective(self, x: FloatArray) -> float:
        """Value of f / penalty, with all violations."""
        n = self.nlp.n
        return float(self.nlp.objective(x[:n]) / self.penalty + self._weights @ x[n:])

    def _gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of the objective, shape (n,)."""
        n = self.nlp.n
        return np.concatenate([self.nlp.gradient(x[:n]) / self.penalty, self._weights])

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of the rows, shape (m,)."""
        n = self.nlp.n
        g = self.nlp.constraints(x[:n]).copy()
        g[self._below] += x[n : n + self._below.size]
        g[self._above] -= x[n + self._below.size :]
        return g

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian in the order of `jacobian_structure`."""
        return np.concatenate([self.nlp.jacobian(x[: self.nlp.n]), self._signs])

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of objective_factor * f / penalty + multipliers @ g."""
        return self.nlp.hessian(x[: self.nlp.n], objective_factor / self.penalty, multipliers)
