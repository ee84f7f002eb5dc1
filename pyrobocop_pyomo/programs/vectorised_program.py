"""The nonlinear program of a Pyomo model without a file: repeated terms are evaluated all at once.

Ipopt evaluates such a program by itself (`CompiledRun`): C calls C, and no Python runs between two iterations' ends.
"""

from __future__ import annotations

import ctypes
import importlib.util
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import SolverNotFoundError

from .asl_program import ASL_REMEDY
from .compiled_terms import SumsStructure, evaluation_library
from .model_numbers import ModelNumbers
from .model_terms import ModelTerms
from .nonlinear_program import FloatArray, NonlinearProgram, Scales, finite
from .summed_terms import SummedTerms, place_hessians

# In the order in which Ipopt's C interface takes them, with the structures that come with them.
EVALUATIONS = {
    "objective": None,
    "constraints": None,
    "gradient": None,
    "jacobian": "jacobian_structure",
    "hessian": "hessian_structure",
}


_int, _long, _number, _address = ctypes.c_int32, ctypes.c_int64, ctypes.c_double, ctypes.c_void_p


class _ProgramStructure(ctypes.Structure):
    _fields_ = (
        ("n", _long), ("cost", SumsStructure), ("rows", SumsStructure), ("gradient_columns", _address),
    )  # fmt: skip


class _RunStructure(ctypes.Structure):
    _fields_ = (
        ("program", _address), ("shifts", _address), ("x_scales", _address), ("gradient_scales", _address),
        ("row_scales", _address), ("entry_scales", _address), ("hessian_scales", _address),
        ("objective_scale", _number), ("x", _address),
        ("multipliers", _address), ("undefined_at", _address), ("undefined", _int), ("jacobian_rows", _address),
        ("jacobian_columns", _address), ("hessian_rows", _address), ("hessian_columns", _address),
    )  # fmt: skip


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
    arguments : SummedTerms
        Arguments of the model's Python functions.

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
        self.n, self.m = len(terms.variables), len(terms.constraints)
        self._library = library = evaluation_library()
        self.cost = SummedTerms(terms.cost, 1, self.n, library)
        self.rows = SummedTerms(terms.rows, self.m, self.n, library)
        count = sum(len(call.arguments) for call in terms.calls.calls)
        self.arguments = SummedTerms(terms.arguments, count, self.n, library)
        self.jacobian_structure = self.rows.structure
        self.hessian_structure = place_hessians([self.cost, self.rows], self.n)
        place_hessians([self.arguments], self.n)
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
        for sums in (self.cost, self.rows, self.arguments):
            sums.set_parameters(self.numbers.parameters)
        self.x_start = self.numbers.values_of_variables()

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return float(finite(self.cost.values(x), "CasADi", "objective")[0])

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f."""
        gradient = np.zeros(self.n)
        gradient[self.cost.structure[1]] = self.cost.jacobian(x)
        return finite(gradient, "CasADi", "gradient of the objective")

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g."""
        return finite(self.rows.values(x), "CasADi", "constraints")

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g."""
        return finite(self.rows.jacobian(x), "CasADi", "Jacobian of the constraints")

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian."""
        values = np.zeros(self.hessian_structure[0].size)
        self.cost.add_hessian(x, np.array([objective_factor]), values)
        self.rows.add_hessian(x, multipliers, values)
        return finite(values, "CasADi", "Hessian of the Lagrangian")

    def compiled_run(self, scales: Scales | None = None, shifts: FloatArray | None = None) -> CompiledRun | None:
        """The functions for Ipopt without Python, None without the compiled evaluation; see `CompiledRun`."""
        return None if self._library is None else CompiledRun(self, self._library, scales, shifts)


class CompiledRun:
    """The functions of a program, or of the same in other units, for one run of Ipopt.

    Parameters
    ----------
    program : VectorisedProgram
    library : ctypes.CDLL
    scales : Scales, optional
        The units of the point that Ipopt has; see `ScaledProgram`.
    shifts : float array, shape (m,), optional
        By how much rows are moved, read at each evaluation; see `ShiftedRows`.

    Attributes
    ----------
    functions : dict of str to int
        Addresses of the functions by their names in `NonlinearProgram`.
    data : int
        Address of what they get as their last argument.
    """

    def __init__(
        self,
        program: VectorisedProgram,
        library: ctypes.CDLL,
        scales: Scales | None = None,
        shifts: FloatArray | None = None,
    ) -> None:
        jacobian, hessian = program.jacobian_structure, program.hessian_structure
        self._arrays: list[np.ndarray] = []
        self._owners = program.cost, program.rows
        structures = [self._kept(places, np.int32) for places in (*jacobian, *hessian)]
        self._undefined_at = np.empty(program.n)
        self._program = _ProgramStructure(
            program.n, program.cost.sums, program.rows.sums, self._kept(program.cost.structure[1], np.int32)
        )
        units: list[int | None] = [None] * 5
        objective_scale = 1.0
        if scales is not None:
            objective_scale = scales.objective
            factors = (
                scales.x,
                scales.x / scales.objective,
                scales.g,
                scales.x[jacobian[1]] / scales.g[jacobian[0]],
                scales.x[hessian[0]] * scales.x[hessian[1]],
            )
            units = [self._kept(factor) for factor in factors]
        self._run = _RunStructure(
            ctypes.addressof(self._program), None if shifts is None else self._kept(shifts),
            *units, objective_scale, self._kept(np.empty(program.n)),
            self._kept(np.empty(program.m)), self._undefined_at.ctypes.data, 0, *structures,
        )  # fmt: skip
        self.functions = {
            name: ctypes.cast(getattr(library, f"run_{name}"), ctypes.c_void_p).value or 0 for name in EVALUATIONS
        }
        self.data = ctypes.addressof(self._run)

    def _kept(self, values: np.ndarray, kind: Any = np.float64) -> int:
        """Address of an array that lives as long as this object."""
        array = np.ascontiguousarray(values, dtype=kind)
        self._arrays.append(array)
        address: int = array.ctypes.data
        return address

    def begin(self) -> None:
        """Forget the run before."""
        self._run.undefined = 0

    @property
    def undefined_at(self) -> FloatArray | None:
        """The last point, in Ipopt's units, at which a value or a derivative did not exist."""
        return self._undefined_at.copy() if self._run.undefined else None


def compiled_run_of(
    nlp: NonlinearProgram, scales: Scales | None = None, shifts: FloatArray | None = None
) -> CompiledRun | None:
    """The functions of a program for Ipopt without Python; None where Python has to evaluate any of them.

    A program offers them by a method ``compiled_run(scales, shifts)``. That of a base class does not count: a subclass
    has to say itself what is compiled of it.
    """
    is_own = "compiled_run" in vars(type(nlp))
    return nlp.compiled_run(scales, shifts) if is_own else None  # type: ignore[attr-defined]
