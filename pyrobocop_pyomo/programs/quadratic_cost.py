"""A quadratic function added to a program's objective as numbers, so that changing it rebuilds nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
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
    blocks : sequence of int arrays, optional
        Positions in `variables` whose products may appear, as those of a dense penalty: each block makes a dense square
        of the Hessian. Without them Q is diagonal.

    Attributes
    ----------
    linear : float array, shape (len(variables),)
    diagonal : float array, shape (len(variables),)
        The diagonal of Q.
    dense : list of float arrays
        A symmetric matrix for each block, added to the diagonal.
    """

    def __init__(self, variables: Sequence[Any], blocks: Sequence[ArrayLike] = ()) -> None:
        self.variables = list(variables)
        self.linear, self.diagonal = np.zeros(len(self.variables)), np.zeros(len(self.variables))
        self.blocks = [np.asarray(block, dtype=np.intp) for block in blocks]
        self.dense = [np.zeros((block.size, block.size)) for block in self.blocks]

    def product(self, values: FloatArray) -> FloatArray:
        """``Q @ values``."""
        product = self.diagonal * values
        for block, matrix in zip(self.blocks, self.dense, strict=True):
            product[block] += matrix @ values[block]
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
    sign : float
        -1 where the program is the negative of a maximised objective; the cost is then subtracted from the maximum.

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
        rows, columns_of_block, self._picks = self._pattern(columns)
        self.hessian_structure = (
            np.concatenate([nlp.hessian_structure[0], rows]).astype(np.int32),
            np.concatenate([nlp.hessian_structure[1], columns_of_block]).astype(np.int32),
        )
        self.read_fixed()

    def read_fixed(self) -> None:
        """Read the values of fixed variables again."""
        self._values[self._fixed] = [variable.value for variable in self._fixed_variables]

    def _pattern(self, columns: Any) -> tuple[Any, Any, list[Any]]:
        """Rows and columns of the Hessian's new entries, and which entry of each block they are."""
        rows, others, picks = [self._columns], [self._columns], []
        for block in self._cost.blocks:
            first, second = np.tril_indices(block.size)
            a, b = columns[block[first]], columns[block[second]]
            used = np.flatnonzero((a >= 0) & (b >= 0))
            picks.append((first[used], second[used]))
            rows.append(np.maximum(a[used], b[used]))
            others.append(np.minimum(a[used], b[used]))
        return np.concatenate(rows), np.concatenate(others), picks

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
        added = [self._cost.diagonal[self._free]]
        added += [matrix[pick] for matrix, pick in zip(self._cost.dense, self._picks, strict=True)]
        return np.concatenate(
            [self.nlp.hessian(x, objective_factor, multipliers), objective_factor * np.concatenate(added)]
        )
