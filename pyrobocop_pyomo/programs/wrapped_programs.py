"""Nonlinear programs made from others: within other bounds, with moved or elastic rows, in other units.

A quadratic function added to a program's objective as numbers, so that changing it rebuilds nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pyomo.common.collections import ComponentMap

from pyrobocop_pyomo.errors import ModelError

from .nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint, Scales
from .vectorised_program import EVALUATIONS, CompiledRun, compiled_run_of


class WrappedProgram:
    """A nonlinear program within other bounds of its variables; a subclass replaces what else differs.

    Parameters
    ----------
    nlp : NonlinearProgram
    x_lower, x_upper : float array, shape (n,), optional
        By default those of the program.
    """

    objective: Callable[[FloatArray], float]
    gradient: Callable[[FloatArray], FloatArray]
    constraints: Callable[[FloatArray], FloatArray]
    jacobian: Callable[[FloatArray], FloatArray]
    hessian: Callable[[FloatArray, float, FloatArray], FloatArray]

    def __init__(
        self, nlp: NonlinearProgram, x_lower: FloatArray | None = None, x_upper: FloatArray | None = None
    ) -> None:
        self.nlp = nlp
        self.derivatives = nlp.derivatives
        self.n, self.m = nlp.n, nlp.m
        self.x_lower = nlp.x_lower if x_lower is None else x_lower
        self.x_upper = nlp.x_upper if x_upper is None else x_upper
        self.g_lower, self.g_upper = nlp.g_lower, nlp.g_upper
        self.x_start = nlp.x_start
        self.jacobian_structure, self.hessian_structure = nlp.jacobian_structure, nlp.hessian_structure
        for name in EVALUATIONS:
            if not hasattr(type(self), name):
                # Forwarded as it is: one call less per evaluation.
                setattr(self, name, getattr(nlp, name))

    def compiled_run(self, scales: Scales | None = None, shifts: FloatArray | None = None) -> CompiledRun | None:
        """The functions for Ipopt without Python; see `compiled_run_of`, and there what a subclass has to say."""
        return compiled_run_of(self.nlp, scales, shifts)


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
        self._shifts = np.zeros(nlp.m)
        self.delta = float(self.base.max(initial=0.0))

    @property
    def delta(self) -> float | FloatArray:
        """The bound that the solver sees."""
        return self._delta

    @delta.setter
    def delta(self, bound: float | FloatArray) -> None:
        self._delta = bound
        self._shifts[self.rows] = self.base - bound

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g, the marked rows moved by base - delta."""
        return self.nlp.constraints(x) + self._shifts

    def compiled_run(self, scales: Scales | None = None, shifts: FloatArray | None = None) -> CompiledRun | None:
        """The functions for Ipopt without Python, the rows moved as in Python; see `CompiledRun`."""
        return compiled_run_of(self.nlp, scales, self._shifts) if shifts is None else None


class ScaledProgram(WrappedProgram):
    """A nonlinear program in the units of `scales`: in variables, rows and an objective of size one.

    Parameters
    ----------
    nlp : NonlinearProgram
        May change between evaluations, as `ShiftedRows` does.
    scales : Scales
    """

    def __init__(self, nlp: NonlinearProgram, scales: Scales) -> None:
        super().__init__(nlp, nlp.x_lower / scales.x, nlp.x_upper / scales.x)
        self.scales = scales
        self.g_lower, self.g_upper = nlp.g_lower / scales.g, nlp.g_upper / scales.g
        self.x_start = nlp.x_start / scales.x
        rows, columns = nlp.jacobian_structure
        self._jacobian_factors = scales.x[columns] / scales.g[rows]
        rows, columns = nlp.hessian_structure
        self._hessian_factors = scales.x[rows] * scales.x[columns]

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return self.nlp.objective(self.scales.x * x) / self.scales.objective

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f, shape (n,)."""
        return self.nlp.gradient(self.scales.x * x) * (self.scales.x / self.scales.objective)

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g, shape (m,)."""
        return self.nlp.constraints(self.scales.x * x) / self.scales.g

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g in the order of `jacobian_structure`."""
        return self.nlp.jacobian(self.scales.x * x) * self._jacobian_factors

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian in the order of `hessian_structure`."""
        values = self.nlp.hessian(
            self.scales.x * x, objective_factor / self.scales.objective, multipliers / self.scales.g
        )
        return values * self._hessian_factors

    def compiled_run(self, scales: Scales | None = None, shifts: FloatArray | None = None) -> CompiledRun | None:
        """The functions for Ipopt without Python, in these units; see `CompiledRun`."""
        return compiled_run_of(self.nlp, self.scales) if scales is None and shifts is None else None


class ElasticRows(WrappedProgram):
    r"""Minimise :math:`f(x) / \rho + \sum_i (p_i + q_i)` with rows :math:`g(x) + p - q` and :math:`p, q \ge 0`.

    A row has a `p` where it has a lower bound and a `q` where it has an upper one. Any point can be completed to one
    that meets all rows, and the Jacobian has full rank whatever that of ``g`` is. Where the penalty :math:`\rho`
    exceeds all multipliers of a solution, that solution is one of this program too, with :math:`p = q = 0`.

    Parameters
    ----------
    nlp : NonlinearProgram
    penalty : float
        Of a unit of violation, in units of the objective.

    References
    ----------
    Gill, Murray & Saunders, SNOPT: an SQP algorithm for large-scale constrained optimization, SIAM Review 47 (2005),
    sec. 4.6, doi:10.1137/S0036144504446096
    """

    def __init__(self, nlp: NonlinearProgram, penalty: float) -> None:
        super().__init__(nlp)
        self.penalty = penalty
        below, above = np.flatnonzero(np.isfinite(nlp.g_lower)), np.flatnonzero(np.isfinite(nlp.g_upper))
        self._below, self._above = below, above
        added = below.size + above.size
        self.n = nlp.n + added
        self.x_lower = np.concatenate([nlp.x_lower, np.zeros(added)])
        self.x_upper = np.concatenate([nlp.x_upper, np.full(added, np.inf)])
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

    def inner(self, point: PrimalDualPoint) -> PrimalDualPoint:
        """The point of the program behind a point of this one: multipliers differ by the factor of the objective."""
        rows, lower, upper = point.complete(self)
        n, penalty = self.nlp.n, self.penalty
        return PrimalDualPoint(point.x[:n], penalty * rows, penalty * lower[:n], penalty * upper[:n])

    def objective(self, x: FloatArray) -> float:
        """Value of f / penalty, with all violations."""
        n = self.nlp.n
        return float(self.nlp.objective(x[:n]) / self.penalty + x[n:].sum())

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of the objective, shape (n,)."""
        n = self.nlp.n
        return np.concatenate([self.nlp.gradient(x[:n]) / self.penalty, np.ones(self.n - n)])

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


# ----------------------------------------------------------------------------------------------------- a quadratic cost


class QuadraticCost:
    """``linear @ v + v @ Q @ v / 2`` in chosen variables of a model, whose numbers may change before each solve.

    Proximal terms and multipliers of a decomposition are such functions. Stated in Pyomo they would need a mutable
    Param for each number, and derivatives by the source of derivatives.

    Parameters
    ----------
    variables : sequence of VarData
        ``v``, each once.
    dense : int
        How many of them, from the first on, appear in products with each other. Of the others Q is diagonal.

    Attributes
    ----------
    linear : float array, shape (len(variables),)
    diagonal : float array, shape (len(variables),)
        The diagonal of Q.
    dense : float array, shape (dense, dense)
        A symmetric matrix that is added to it.
    """

    def __init__(self, variables: Sequence[Any], dense: int = 0) -> None:
        self.variables = list(variables)
        self.linear, self.diagonal = np.zeros(len(self.variables)), np.zeros(len(self.variables))
        self.dense = np.zeros((dense, dense))

    def product(self, values: FloatArray) -> FloatArray:
        """``Q @ values``."""
        product = self.diagonal * values
        product[: len(self.dense)] += self.dense @ values[: len(self.dense)]
        return product


class AddedQuadraticCost(WrappedProgram):
    """A nonlinear program with a `QuadraticCost` added to its objective.

    Parameters
    ----------
    nlp : NonlinearProgram
    variables : sequence of VarData
        Of the program, in its order.
    cost : QuadraticCost
        Its numbers are read at each evaluation.

    Raises
    ------
    ModelError
        When the cost has a free variable that nothing else of the model uses.
    """

    def __init__(self, nlp: NonlinearProgram, variables: Sequence[Any], cost: QuadraticCost) -> None:
        super().__init__(nlp)
        self._cost = cost
        column_of = ComponentMap((variable, column) for column, variable in enumerate(variables))
        missing = [v for v in cost.variables if not v.fixed and v not in column_of]
        if missing:
            raise ModelError(
                f"'{missing[0].name}': is shared or penalised, but appears in no row and no objective of its model. "
                "Use it there, or leave it out."
            )
        columns = np.array([column_of.get(v, -1) for v in cost.variables], dtype=np.intp)
        self._free = np.flatnonzero(columns >= 0)
        self._columns = columns[self._free]
        self._fixed = np.flatnonzero(columns < 0)
        self._fixed_variables = [cost.variables[i] for i in self._fixed]
        self._values = np.zeros(columns.size)
        first, second = np.tril_indices(len(cost.dense))
        pair = np.sort([columns[first], columns[second]], axis=0)
        of_free = pair[0] >= 0
        self._pick = first[of_free], second[of_free]
        lower, upper = np.concatenate([np.array([self._columns, self._columns]), pair[:, of_free]], axis=1)
        self.hessian_structure = (
            np.concatenate([nlp.hessian_structure[0], upper]).astype(np.int32),
            np.concatenate([nlp.hessian_structure[1], lower]).astype(np.int32),
        )
        self.read_fixed()

    def read_fixed(self) -> None:
        """Read the values of fixed variables again."""
        self._values[self._fixed] = [variable.value for variable in self._fixed_variables]

    def _at(self, x: FloatArray) -> FloatArray:
        self._values[self._free] = x[self._columns]
        return self._values

    def objective(self, x: FloatArray) -> float:
        """Value of the objective with the cost."""
        values = self._at(x)
        return float(self.nlp.objective(x) + values @ (self._cost.linear + self._cost.product(values) / 2))

    def gradient(self, x: FloatArray) -> FloatArray:
        """Its gradient, shape (n,)."""
        gradient = self.nlp.gradient(x).copy()
        gradient[self._columns] += (self._cost.linear + self._cost.product(self._at(x)))[self._free]
        return gradient

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian, those of the cost behind those of the program."""
        added = np.concatenate([self._cost.diagonal[self._free], self._cost.dense[self._pick]])
        return np.concatenate([self.nlp.hessian(x, objective_factor, multipliers), objective_factor * added])
