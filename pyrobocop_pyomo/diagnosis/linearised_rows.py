"""Rows, variables and the Jacobian of a model at its current values, by Pyomo's own differentiation."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.common.collections import ComponentMap
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.calculus.diff_with_pyomo import DifferentiationException, reverse_ad
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.modeling.row_violations import number_or_nan
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.optional_imports import scipy

NAN = float("nan")

# What Pyomo raises for an expression without a value: a missing value, a division by zero, an overflow, a domain.
NO_VALUE = (ValueError, TypeError, ArithmeticError)


@dataclass(frozen=True)
class Row:
    """One active constraint at the current values.

    Attributes
    ----------
    data : constraint data
    residual : float
        Body less right-hand side of an equality, violation of an inequality; NaN where it has no value.
    gradient : dict of column number to float
        Derivatives by the variables that may move; a NaN where one does not exist.
    """

    data: Any
    residual: float
    gradient: dict[int, float]

    @property
    def is_finite(self) -> bool:
        """True when value and derivatives are numbers."""
        return math.isfinite(self.residual) and all(map(math.isfinite, self.gradient.values()))


class LinearisedRows:
    """All active rows of a block and below, in all variables that may move.

    Parameters
    ----------
    block : Block
    """

    def __init__(self, block: Any) -> None:
        data = block.component_data_objects(Constraint, active=True, descend_into=Block)
        constraints = list(data)
        variables: dict[int, Any] = {}
        variables_of = [list(variables_in(row.body, include_fixed=False)) for row in constraints]
        for some in variables_of:
            variables.update((id(variable), variable) for variable in some)
        self.variables = list(variables.values())
        self.column = {number: i for i, number in enumerate(variables)}
        self.rows = [
            Row(row, residual_of(row), {self.column[id(v)]: g for v, g in gradient(row.body, some)})
            for row, some in zip(constraints, variables_of, strict=True)
        ]

    @cached_property
    def equalities(self) -> list[Row]:
        """The rows that are equalities and hold a variable that may move."""
        return [row for row in self.rows if row.data.equality and row.gradient]

    def jacobian(self, rows: Iterable[Row]) -> Any:
        """Sparse matrix of the gradients of some rows, in all variables."""
        triplets = [(i, j, entry) for i, row in enumerate(rows) for j, entry in row.gradient.items()]
        i, j, entries = zip(*triplets, strict=True) if triplets else ((), (), ())
        count = len(list(rows))
        return scipy.sparse.csr_matrix((entries, (i, j)), shape=(count, len(self.variables)))


def residual_of(row: Any) -> float:
    """Body less right-hand side of an equality, violation of an inequality; NaN without a value."""
    body = number_or_nan(row.body)
    lower, upper = number_or_nan(row.lower, -math.inf), number_or_nan(row.upper, math.inf)
    if math.isnan(lower) or math.isnan(upper):
        return NAN
    return body - upper if row.equality else max(lower - body, body - upper, 0.0 * body)


def gradient(body: Any, variables: Iterable[Any]) -> Iterator[tuple[Any, float]]:
    """Derivatives of an expression by some of its variables; NaN where Pyomo gives none."""
    variables = list(variables)
    if not variables:
        return
    derivatives = ComponentMap()
    if all(variable.value is not None for variable in variables_in(body)):  # else Pyomo logs an error for each
        with contextlib.suppress(*NO_VALUE, DifferentiationException):
            derivatives = reverse_ad(body)
    for variable in variables:
        derivative = derivatives.get(variable, NAN)
        real = derivative.__class__ in native_numeric_types and not isinstance(derivative, complex)
        yield variable, float(derivative) if real else NAN


def equilibrate(matrix: Any, rounds: int = 10) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Factors of rows and columns that bring the largest entry of each near one.

    References
    ----------
    Ruiz, A scaling algorithm to equilibrate both rows and columns norms in matrices, RAL-TR-2001-034
    """
    rows, columns = np.ones(matrix.shape[0]), np.ones(matrix.shape[1])
    if 0 in matrix.shape:
        return rows, columns
    magnitude = abs(matrix).tocsr()
    for _ in range(rounds):
        scaled = scipy.sparse.diags(rows) @ magnitude @ scipy.sparse.diags(columns)
        by_row = scaled.max(axis=1).toarray().ravel()
        by_column = scaled.max(axis=0).toarray().ravel()
        rows /= np.sqrt(np.where(by_row > 0, by_row, 1.0))
        columns /= np.sqrt(np.where(by_column > 0, by_column, 1.0))
    return rows, columns
