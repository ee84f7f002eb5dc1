"""Models as ``.nl`` files, and the derivatives that the AMPL Solver Library takes of them, through PyNumero."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyomo.repn.util
from pyomo.common.env import CtypesEnviron
from pyomo.common.errors import InvalidValueError
from pyomo.common.fileutils import find_file
from pyomo.contrib.pynumero.asl import AmplInterface
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.var import VarData
from pyomo.repn.plugins.nl_writer import NLWriter
from pyomo.solvers.amplfunc_merge import amplfunc_merge

from pyrobocop_pyomo.diagnosis.values import named_undefined_rows
from pyrobocop_pyomo.errors import EvaluationError, PyRobocopError, SolverNotFoundError

from .model_checks import check_variables, refuse_function_calls
from .nonlinear_program import FloatArray, finite, scattered

ASL_REMEDY = (
    "Run 'python build_asl.py' in a clone (Debian, Ubuntu), or install conda-forge's pynumero_libraries, "
    "or run 'pyomo build-extensions'"
)


def find_asl_library() -> str | None:
    """Path of PyNumero's ``pynumero_ASL`` library, or None.

    Pyomo's own places come first (its configuration folder, LD_LIBRARY_PATH, PATH); then the library folder of
    this Python environment, where ``build_asl.py`` puts it.
    """
    if AmplInterface.available():
        return str(AmplInterface.libname)
    found: str | None = find_file("*pynumero_ASL.*", cwd=False, pathlist=[os.path.join(sys.prefix, "lib")])
    return found


def asl_available() -> bool:
    """Whether `AslProgram` can be built on this machine."""
    return find_asl_library() is not None


class AslProgram:
    """The nonlinear program in a ``.nl`` file, evaluated by the AMPL Solver Library.

    Parameters
    ----------
    path : str or Path
        The file, with continuous variables and one objective; it may be removed afterwards. PyNumero's library ends the
        process where it does not support a file.
    external_functions : str
        Libraries with the model's external functions, in the form of the variable ``AMPLFUNC``.

    Raises
    ------
    SolverNotFoundError
        When PyNumero's library is not found.
    """

    derivatives = "ASL through PyNumero"

    def __init__(self, path: str | Path, external_functions: str = "") -> None:
        library = find_asl_library()
        if library is None:
            raise SolverNotFoundError(
                f"PyNumero's library pynumero_ASL is not found, so ASL cannot give derivatives. {ASL_REMEDY}; "
                "or use CasADi: pip install 'pyrobocop_pyomo[ipopt]'."
            )
        if not AmplInterface.available():
            AmplInterface.libname = library  # Pyomo itself found none: nothing of the user's is overruled
        with CtypesEnviron(AMPLFUNC=external_functions):
            self._asl = AmplInterface(str(path))
        self.n = self._asl.get_n_vars()
        self._pattern = scattered(self.n)
        self.m = self._asl.get_n_constraints()
        self.x_lower, self.x_upper = np.empty(self.n), np.empty(self.n)
        self.g_lower, self.g_upper = np.empty(self.m), np.empty(self.m)
        self._asl.get_x_lower_bounds(self.x_lower)
        self._asl.get_x_upper_bounds(self.x_upper)
        self._asl.get_g_lower_bounds(self.g_lower)
        self._asl.get_g_upper_bounds(self.g_upper)
        for bounds in (self.x_lower, self.x_upper, self.g_lower, self.g_upper):
            # ASL's infinity is 1.7e308 on some builds; beyond 1e19 a bound is no bound to Ipopt either.
            bounds[np.abs(bounds) >= 1e19] = np.copysign(np.inf, bounds[np.abs(bounds) >= 1e19])
        self.x_start = np.empty(self.n)
        self._asl.get_init_x(self.x_start)
        jacobian = np.empty((2, self._asl.get_nnz_jac_g()), dtype=np.intc)
        hessian = np.empty((2, self._asl.get_nnz_hessian_lag()), dtype=np.intc)
        self._asl.struct_jac_g(jacobian[0], jacobian[1])
        self._asl.struct_hes_lag(hessian[0], hessian[1])
        self.jacobian_structure = (jacobian[0] - 1, jacobian[1] - 1)  # the interface counts from one
        # ASL stores the upper triangle by rows; mirrored it is the lower one.
        self.hessian_structure = (hessian.max(axis=0) - 1, hessian.min(axis=0) - 1)

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return float(self._asked("objective", self._asl.eval_f, x))

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f."""
        # Without the value at this very point ASL has no error to return, and ends the process instead.
        self.objective(x)
        return self._asked("gradient", self._asl.eval_deriv_f, x, np.empty(self.n))

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g."""
        return self._asked("constraints", self._asl.eval_g, x, np.empty(self.m))

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g."""
        self.constraints(x)
        return self._asked("jacobian", self._asl.eval_jac_g, x, np.empty(self.jacobian_structure[0].size))

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian."""
        self._prepare_hessian(x)
        values = np.empty(self.hessian_structure[0].size)
        self._asl.eval_hes_lag(x, multipliers, values, objective_factor)
        return finite(values, "ASL", "Hessian of the Lagrangian")

    def _prepare_hessian(self, x: FloatArray) -> None:
        """Evaluate the functions where the second derivatives are wanted, and make sure that these exist.

        ASL takes these at the point where it last evaluated the functions, whatever x it is given. And where one is
        infinite, as that of x**1.5 at 0, it has no error to return: it ends the process. So a point with a variable
        on a bound or at zero, where that happens, is moved off by about rounding, each variable by another number
        so that differences do not stay zero. Elsewhere the first derivatives, which report what is wrong with the
        second ones as well, are evaluated before.
        """
        on_edge = (x == self.x_lower) | (x == self.x_upper) | (x == 0.0)
        if on_edge.any():
            with np.errstate(all="ignore"):
                step = np.where(x == self.x_upper, -1.0, 1.0) * 1e-10 * (1.0 + np.abs(x)) * (1.0 + self._pattern)
                moved, back = x + step, x - step
            try:
                self._evaluate_derivatives(moved)
            except EvaluationError:
                self._evaluate_derivatives(back)
        else:
            self._evaluate_derivatives(x)

    def _evaluate_derivatives(self, x: FloatArray) -> None:
        self.gradient(x)
        self.jacobian(x)

    def _asked(self, name: str, function: Callable[..., Any], x: FloatArray, *filled: FloatArray) -> FloatArray:
        """The array that a function of ASL fills, or what it returns; its own errors are arithmetic ones."""
        try:
            value = function(x, *filled)
        except ArithmeticError as error:
            raise EvaluationError(f"ASL cannot evaluate the {name}: {error}") from None
        return finite(filled[0] if filled else np.array(value), "ASL", name)


# How a model is written wherever this package writes one. Named expressions are written out: not every ASL
# differentiates them rightly (docs/developer/evaluation.md). Presolving and scaling in the writer would alter the
# multipliers of a warm start.
WRITER_OPTIONS = {"linear_presolve": False, "scale_model": False, "export_defined_variables": False}


def program_of_file(model: BlockData, has_objective: bool) -> tuple[AslProgram, list[VarData], list[ConstraintData]]:
    """Write a model, and let ASL read it; returns the program, and what its variables and rows are.

    Raises
    ------
    ModelError, EvaluationError
        As `checked_writing`.
    FunctionError
        For a model that calls functions in Python.
    SolverNotFoundError
        When PyNumero's library is not found.
    """
    text = io.StringIO()
    with checked_writing(model):
        info = NLWriter().write(model, text, **WRITER_OPTIONS)
        for word in ("nan", "inf"):  # no other words are in a file without names; ASL reads these as zeros
            if word in text.getvalue():
                raise InvalidValueError(word)
    check_variables(model, info.variables)
    # ASL takes everything from the file at once: it can go as soon as the program exists.
    with tempfile.TemporaryDirectory(prefix="pyrobocop_") as folder:
        path = Path(folder) / "model.nl"
        content = text.getvalue() if has_objective else _with_objective(text.getvalue())
        path.write_text(content, encoding="utf-8", newline="\n")
        nlp = AslProgram(path, amplfunc_merge(os.environ, *info.external_function_libraries))
    return nlp, info.variables, info.constraints


def _is_not_raised_as_well(record: logging.LogRecord) -> bool:
    """Whether a message of Pyomo's writer says more than the error that follows it."""
    return not str(record.msg).startswith("Exception encountered evaluating expression")


@contextlib.contextmanager
def checked_writing(model: BlockData) -> Iterator[None]:
    """Context in which a model is written to a ``.nl`` file.

    Pyomo's writer warns of a term whose number does not exist, leaves it out and goes on; here it stops.

    Raises
    ------
    FunctionError, ModelError
        When the model calls functions that ASL cannot.
    EvaluationError
        When a number in an expression does not exist.
    """
    refuse_function_calls(model)
    before = pyomo.repn.util.HALT_ON_EVALUATION_ERROR
    pyomo.repn.util.HALT_ON_EVALUATION_ERROR = True
    pyomo.repn.util.logger.addFilter(_is_not_raised_as_well)
    try:
        yield
    except PyRobocopError:
        raise
    except (ArithmeticError, InvalidValueError, ValueError) as error:
        where = named_undefined_rows(model)
        if not where and not isinstance(error, (ArithmeticError, InvalidValueError)):
            raise  # the writer objects to something else
        raise EvaluationError(
            f"'{model.name}': a number in an expression does not exist: {where or error}. Give Params and fixed "
            "variables values that it is defined for."
        ) from None
    finally:
        pyomo.repn.util.logger.removeFilter(_is_not_raised_as_well)
        pyomo.repn.util.HALT_ON_EVALUATION_ERROR = before


def _with_objective(text: str) -> str:
    """The file with the objective zero: ASL wants one."""
    *header, segments = text.split("\n", 10)  # all lines of a header
    counts = header[1].split()
    header[1] = " ".join(["", *counts[:2], "1", *counts[3:]])
    return "\n".join([*header, "O0 0", "n0", segments])
