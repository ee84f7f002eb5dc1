"""A quadratic function added to a program's objective as numbers, so that changing it rebuilds nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap

from pyrobocop_pyomo.errors import ModelError

from .nonlinear_program import FloatArray, NonlinearProgram
from .wrapped_programs import WrappedProgram


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
