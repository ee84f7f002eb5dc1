"""The nonlinear program of a Pyomo model without a file: repeated terms are evaluated all at once."""

from __future__ import annotations

import importlib.util

import numpy as np

from pyrobocop_pyomo.errors import SolverNotFoundError

from .asl_program import ASL_REMEDY
from .compiled_terms import CompiledRun, evaluation_library
from .model_numbers import ModelNumbers
from .model_terms import ModelTerms
from .nonlinear_program import FloatArray, Scales, finite
from .summed_terms import SummedTerms, place_hessians


def casadi_available() -> bool:
    """Whether CasADi is installed; it is looked up and not imported, which would cost half a second."""
    return importlib.util.find_spec("casadi") is not None


class VectorisedProgram:
    """The nonlinear program of a Pyomo model, whose repeated terms are functions vectorised by CasADi.

    Parameters
    ----------
    terms : ModelTerms
        From `collect_terms`. Fixed variables and mutable Params are numbers that `refresh` reads again.

    Attributes
    ----------
    numbers : ModelNumbers
    cost, rows : SummedTerms
    arguments : list of SummedTerms
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
        if not casadi_available():
            raise SolverNotFoundError(
                "there is nothing here to take derivatives with: CasADi is not installed. Run: pip install "
                f"'pyrobocop_pyomo[ipopt]'; or take derivatives='asl'. {ASL_REMEDY}."
            )
        self.numbers = ModelNumbers(terms)
        self.x_lower, self.x_upper = self.numbers.x_lower, self.numbers.x_upper
        self.g_lower, self.g_upper = self.numbers.g_lower, self.numbers.g_upper
        self.g_multipliers_start: FloatArray | None = None
        self.n, self.m = len(terms.variables), len(terms.constraints)
        self._library = library = evaluation_library()
        self.cost = SummedTerms(terms.cost, 1, self.n, library)
        self.rows = SummedTerms(terms.rows, self.m, self.n, library)
        self.arguments = [SummedTerms(rows, m, self.n, library) for rows, m in terms.arguments]
        self.jacobian_structure = self.rows.structure
        self.hessian_structure = place_hessians([self.cost, self.rows], self.n)
        for arguments in self.arguments:
            place_hessians([arguments], self.n)
        self._read_point()

    def refresh(self) -> None:
        """Read fixed variables, mutable Params, bounds and the first point again from the model.

        Raises
        ------
        ModelError
            When other variables are free or other rows active than before.
        InfeasibleConstraintException
            When a row without free variables contradicts itself.
        """
        self.numbers.refresh()
        self._read_point()

    def _read_point(self) -> None:
        for sums in (self.cost, self.rows, *self.arguments):
            sums.set_parameters(self.numbers.parameters)
        self.x_start = self.numbers.values_of_variables()

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return float(finite(self.cost.compiled.values(x), "CasADi", "objective")[0])

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f."""
        gradient = np.zeros(self.n)
        gradient[self.cost.structure[1]] = self.cost.compiled.jacobian(x)
        return finite(gradient, "CasADi", "gradient of the objective")

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g."""
        return finite(self.rows.compiled.values(x), "CasADi", "constraints")

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g."""
        return finite(self.rows.compiled.jacobian(x), "CasADi", "Jacobian of the constraints")

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian."""
        values = np.zeros(self.hessian_structure[0].size)
        self.cost.compiled.add_hessian(x, np.array([objective_factor]), values)
        self.rows.compiled.add_hessian(x, multipliers, values)
        return finite(values, "CasADi", "Hessian of the Lagrangian")

    def compiled_run(self, scales: Scales | None = None) -> CompiledRun | None:
        """The functions for Ipopt without Python, None without the compiled evaluation; see `CompiledRun`.

        Parameters
        ----------
        scales : Scales, optional
            The units of the point that Ipopt has.
        """
        if self._library is None:
            return None
        return CompiledRun(
            self._library, self.cost.compiled, self.rows.compiled, self.n, self.cost.structure[1],
            self.jacobian_structure, self.hessian_structure, scales,
        )  # fmt: skip
