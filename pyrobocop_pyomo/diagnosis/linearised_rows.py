"""The equations of a model and their Jacobian at its current values, by Pyomo's own differentiation."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import chain
from numbers import Real
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.calculus.diff_with_pyomo import DifferentiationException, reverse_ad

from pyrobocop_pyomo.modeling.row_violations import number_or_nan
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy

NAN = float("nan")

# What Pyomo raises for an expression without a value: a missing value, a division by zero, an overflow, a domain.
NO_VALUE = (ValueError, TypeError, ArithmeticError)


class LinearisedRows:
    """Some rows in all variables that may move, at the values that are on the model.

    Parameters
    ----------
    rows : list
        Each has a body.
    include_fixed : bool
        Take derivatives by the fixed variables as well.

    Attributes
    ----------
    rows : list
    variables : list of variable data
    incidence : list of list of int
        Positions in `variables` of what each row holds.
    """

    def __init__(self, rows: Sequence[Any], include_fixed: bool = False) -> None:
        self.rows, self.variables = rows, list[Any]()
        column: dict[int, int] = {}
        self.incidence: list[list[int]] = []
        for row in rows:
            own = list(variables_in(row.body, include_fixed=include_fixed))
            for variable in own:
                if column.setdefault(id(variable), len(column)) == len(self.variables):
                    self.variables.append(variable)
            self.incidence.append([column[id(variable)] for variable in own])

    @cached_property
    def jacobian(self) -> Any:
        """Sparse matrix of derivatives; a NaN where one does not exist."""
        pairs = zip(self.rows, self.incidence, strict=True)
        entries = [entry for row, own in pairs for entry in gradient(row.body, [self.variables[j] for j in own])]
        i = np.repeat(np.arange(len(self.rows)), list(map(len, self.incidence)))
        j = list(chain.from_iterable(self.incidence))
        return scipy.sparse.csr_matrix((entries, (i, j)), shape=(len(self.rows), len(self.variables)), dtype=float)


class Equations(LinearisedRows):
    """All active equations of a block and below that hold a variable that may move: others are judged by their values.

    Parameters
    ----------
    block : Block
    """

    def __init__(self, block: Any) -> None:
        active = block.component_data_objects(Constraint, active=True, descend_into=Block)
        equations = (row for row in active if row.equality)
        super().__init__([row for row in equations if any(True for _ in variables_in(row.body, include_fixed=False))])

    @property
    def residuals(self) -> Array:
        """Bodies less right-hand sides; NaN where there is no value."""
        return np.array([number_or_nan(row.body) - number_or_nan(row.upper) for row in self.rows])


def gradient(body: Any, variables: Iterable[Any]) -> list[float]:
    """Derivatives of an expression by some of its variables; NaN where Pyomo gives none."""
    derivatives = ComponentMap()
    if all(variable.value is not None for variable in variables_in(body)):  # else Pyomo logs an error for each
        with contextlib.suppress(*NO_VALUE, DifferentiationException):
            derivatives = reverse_ad(body)
    numbers = [derivatives.get(variable, NAN) for variable in variables]
    return [float(each) if isinstance(each, Real) else NAN for each in numbers]


def equilibrate(matrix: Any) -> tuple[Array, Array]:
    """Factors that bring the largest entry of each row to one, then those of each column."""
    by_row = abs(matrix).max(axis=1).toarray().ravel()
    rows = 1.0 / np.where(by_row > 0, by_row, 1.0)
    by_column = (scipy.sparse.diags(rows) @ abs(matrix)).max(axis=0).toarray().ravel()
    return rows, 1.0 / np.where(by_column > 0, by_column, 1.0)
