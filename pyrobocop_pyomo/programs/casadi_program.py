"""Derivatives from CasADi's reader of ``.nl`` files: nothing to compile, slower than ASL."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.optional_imports import casadi

from .nonlinear_program import FloatArray, IndexArray, finite


def casadi_available() -> bool:
    """Whether CasADi is installed; it is looked up and not imported, which would cost half a second."""
    return importlib.util.find_spec("casadi") is not None


def require_casadi() -> None:
    """Do nothing when CasADi is installed.

    Raises
    ------
    SolverNotFoundError
        Otherwise.
    """
    if not casadi_available():
        raise SolverNotFoundError(
            "CasADi is not installed, so it cannot give derivatives. Run: pip install 'pyrobocop_pyomo[ipopt]'"
        )


class CasadiProgram:
    """The nonlinear program in a ``.nl`` file, differentiated by CasADi.

    Parameters
    ----------
    path : str or Path
        The file; it may be removed afterwards. It must hold no suffix segments, which CasADi refuses.

    Raises
    ------
    SolverNotFoundError
        When CasADi is missing, or cannot read the file (external functions, rare operators).
    """

    derivatives = "CasADi"

    def __init__(self, path: str | Path) -> None:
        require_casadi()
        builder = casadi.NlpBuilder()
        try:
            builder.import_nl(str(path), {})
        except RuntimeError as error:
            reason = str(error).strip().splitlines()[-1]
            raise SolverNotFoundError(
                f"CasADi cannot read this model from its .nl file: {reason}. ASL reads every operator: run "
                "'python -m pyrobocop_pyomo build-asl', or use the ipopt executable."
            ) from error
        self.n, self.m = len(builder.x), len(builder.g)
        self.x_lower, self.x_upper = np.array(builder.x_lb, dtype=float), np.array(builder.x_ub, dtype=float)
        self.g_lower, self.g_upper = np.array(builder.g_lb, dtype=float), np.array(builder.g_ub, dtype=float)
        self.x_start = np.array(builder.x_init, dtype=float)
        self.g_multipliers_start: FloatArray | None = None
        self._differentiate(builder)

    def _differentiate(self, builder: Any) -> None:
        variables = casadi.veccat(*builder.x)
        read = casadi.Function("functions", [variables], [casadi.MX(builder.f), casadi.veccat(*builder.g)])
        # One scalar graph instead of one matrix node per operation: several times faster to evaluate.
        read = read.expand()
        x = casadi.SX.sym("x", self.n)
        factor = casadi.SX.sym("objective_factor")
        multipliers = casadi.SX.sym("multipliers", self.m)
        objective, constraints = read(x)
        constraints = casadi.densify(casadi.reshape(constraints, self.m, 1))
        jacobian = casadi.jacobian(constraints, x)
        lagrangian = factor * objective + casadi.dot(multipliers, constraints)
        hessian = casadi.tril(casadi.hessian(lagrangian, x)[0])
        self.jacobian_structure = _structure(jacobian)
        self.hessian_structure = _structure(hessian)
        self._objective = _Buffered("objective", [x], casadi.densify(objective))
        self._gradient = _Buffered("gradient", [x], casadi.densify(casadi.gradient(objective, x)))
        self._constraints = _Buffered("constraints", [x], constraints)
        self._jacobian = _Buffered("jacobian", [x], jacobian)
        self._hessian = _Buffered("hessian", [x, factor, multipliers], hessian)

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return float(finite(self._objective(x), "CasADi", "objective")[0])

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f."""
        return finite(self._gradient(x), "CasADi", "gradient of the objective")

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g."""
        return finite(self._constraints(x), "CasADi", "constraints")

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g."""
        return finite(self._jacobian(x), "CasADi", "Jacobian of the constraints")

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian."""
        values = self._hessian(x, np.array([objective_factor]), multipliers)
        return finite(values, "CasADi", "Hessian of the Lagrangian")


def _structure(matrix: Any) -> tuple[IndexArray, IndexArray]:
    """Rows and columns in CasADi's own order of nonzeros (by columns), which is the order of the values."""
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=np.int32), np.array(columns, dtype=np.int32)


class _Buffered:
    """A CasADi function that reads and writes preallocated NumPy memory, without conversion to its matrices."""

    def __init__(self, name: str, arguments: list[Any], result: Any) -> None:
        function = casadi.Function(name, arguments, [result])
        self._arguments = [np.zeros(function.nnz_in(i)) for i in range(len(arguments))]
        self._result = np.zeros(function.nnz_out(0))
        self._buffer, self._evaluate = function.buffer()
        for i, argument in enumerate(self._arguments):
            self._buffer.set_arg(i, argument.data)
        self._buffer.set_res(0, self._result.data)

    def __call__(self, *arguments: FloatArray) -> FloatArray:
        for memory, argument in zip(self._arguments, arguments, strict=True):
            memory[:] = argument
        self._evaluate()
        return self._result.copy()
