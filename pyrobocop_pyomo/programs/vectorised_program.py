"""The nonlinear program of a Pyomo model without a file: repeated terms are evaluated all at once."""

from __future__ import annotations

import numpy as np

from .casadi_program import require_casadi
from .model_numbers import ModelNumbers
from .model_terms import ModelTerms, Terms
from .nonlinear_program import FloatArray, finite
from .sparse_entries import merged_places, summed
from .term_functions import TermFunction, term_functions


class VectorisedProgram:
    """The nonlinear program of a Pyomo model, whose repeated terms are functions vectorised by CasADi.

    Parameters
    ----------
    terms : ModelTerms
        From `collect_terms`. Fixed variables and mutable Params are numbers that `refresh` reads again.

    Attributes
    ----------
    arguments : list of ArgumentRows
        Arguments of the model's Python functions, level by level.

    Raises
    ------
    SolverNotFoundError
        When CasADi is missing.
    InfeasibleConstraintException
        When a row without free variables contradicts itself.
    """

    derivatives = "CasADi on vectorised expressions"

    def __init__(self, terms: ModelTerms) -> None:
        require_casadi()
        self._numbers = ModelNumbers(terms)
        self.x_lower, self.x_upper = self._numbers.x_lower, self._numbers.x_upper
        self.g_lower, self.g_upper = self._numbers.g_lower, self._numbers.g_upper
        self.g_multipliers_start: FloatArray | None = None
        self.n, self.m = len(terms.variables), len(terms.constraints)
        self._cost = _Sums(terms.cost, 1, self.n)
        self._rows = _Sums(terms.rows, self.m, self.n)
        self.arguments = [ArgumentRows(rows, m, self.n) for rows, m in terms.arguments]
        self.jacobian_structure = self._rows.structure
        functions = (*self._cost.functions, *self._rows.functions)
        pairs = [(function.hessian_rows, function.hessian_columns) for function in functions]
        self.hessian_structure, self._hessian_places = merged_places(pairs, self.n)
        self._read_point()

    def refresh(self) -> None:
        """Read fixed variables, mutable Params, bounds and the first point again from the model.

        Raises
        ------
        StructureChanged
            When other variables are free or other rows active than before.
        InfeasibleConstraintException
            When a row without free variables contradicts itself.
        """
        self._numbers.refresh()
        self._read_point()

    def _read_point(self) -> None:
        for sums in (self._cost, self._rows, *(level.sums for level in self.arguments)):
            sums.set_parameters(self._numbers.parameters)
        self.x_start = self._numbers.values_of_variables()

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return float(finite(self._cost.values(x), "CasADi", "objective")[0])

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f."""
        gradient = np.zeros(self.n)
        gradient[self._cost.structure[1]] = self._cost.jacobian(x)
        return finite(gradient, "CasADi", "gradient of the objective")

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g."""
        return finite(self._rows.values(x), "CasADi", "constraints")

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g."""
        return finite(self._rows.jacobian(x), "CasADi", "Jacobian of the constraints")

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian."""
        factor = np.array([objective_factor])
        blocks = [function.hessian(x, factor) for function in self._cost.functions]
        blocks += [function.hessian(x, multipliers) for function in self._rows.functions]
        values = summed(self._hessian_places, blocks, self.hessian_structure[0].size)
        return finite(values, "CasADi", "Hessian of the Lagrangian")


class ArgumentRows:
    """Arguments of Python functions as rows in the variables of a `VectorisedProgram`, which sets the parameters.

    Parameters
    ----------
    terms : Terms
    m, n : int
        Counts of rows and variables.
    """

    def __init__(self, terms: Terms, m: int, n: int) -> None:
        self.m = m
        self.sums = _Sums(terms, m, n)
        self.jacobian_structure = self.sums.structure
        pairs = [(function.hessian_rows, function.hessian_columns) for function in self.sums.functions]
        self.hessian_structure, self._hessian_places = merged_places(pairs, n)

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of the arguments."""
        return finite(self.sums.values(x), "CasADi", "arguments of a Python function")

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of their Jacobian."""
        return finite(self.sums.jacobian(x), "CasADi", "Jacobian of the arguments of a Python function")

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of multipliers @ rows; there is no objective."""
        blocks = [function.hessian(x, multipliers) for function in self.sums.functions]
        values = summed(self._hessian_places, blocks, self.hessian_structure[0].size)
        return finite(values, "CasADi", "Hessian of the arguments of a Python function")


class _Sums:
    """Rows that are each a constant, a linear function and terms of some groups."""

    def __init__(self, terms: Terms, rows: int, n: int) -> None:
        self.functions: list[TermFunction] = term_functions(list(terms.groups.values()), n)
        self._constants = np.zeros(rows)
        for row, constant in terms.constants.items():
            self._constants[row] = constant
        linear_rows = np.array(terms.linear_rows, dtype=np.intp)
        columns = np.array(terms.linear_columns, dtype=np.intp)
        coefficients = np.array(terms.linear_coefficients, dtype=float)
        free = (columns >= 0) & (coefficients != 0.0)
        given = columns < 0
        self._given = linear_rows[given], -1 - columns[given], coefficients[given]
        self._linear = linear_rows[free], columns[free], coefficients[free]
        self._value_rows = np.concatenate([self._linear[0], *(function.rows for function in self.functions)])
        nonlinear = [(function.gradient_rows, function.gradient_columns) for function in self.functions]
        pairs = [self._linear[:2], *nonlinear]
        self.structure, places = merged_places(pairs, n)
        count = self._linear[0].size
        self._size = self.structure[0].size
        self._constant_jacobian = np.bincount(places[:count], self._linear[2], self._size)
        self._places = places[count:]
        self._offsets = self._constants

    def set_parameters(self, values: FloatArray) -> None:
        rows, parameters, coefficients = self._given
        with np.errstate(all="ignore"):  # what is not finite is noticed in the sums
            given = coefficients * values[parameters]
        self._offsets = self._constants + np.bincount(rows, given, self._constants.size)
        for function in self.functions:
            function.set_parameters(values)

    def values(self, x: FloatArray) -> FloatArray:
        _, columns, coefficients = self._linear
        with np.errstate(all="ignore"):
            summands = [coefficients * x.take(columns), *(part.scales * part.value(x) for part in self.functions)]
            return self._offsets + summed(self._value_rows, summands, self._offsets.size)

    def jacobian(self, x: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            blocks = [function.gradient_scales * function.gradient(x) for function in self.functions]
            return self._constant_jacobian + summed(self._places, blocks, self._size)
