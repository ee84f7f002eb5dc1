"""A program that Ipopt evaluates by itself: C calls C, and no Python runs between two iterations' ends."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from .compiled_terms import CompiledSums, SumsStructure
from .nonlinear_program import FloatArray, IndexArray, NonlinearProgram
from .scales import Scales

_long, _int, _number, _address = ctypes.c_int64, ctypes.c_int32, ctypes.c_double, ctypes.c_void_p


# In the order in which Ipopt's C interface takes them, with the structures that come with them.
EVALUATIONS = {
    "objective": None,
    "constraints": None,
    "gradient": None,
    "jacobian": "jacobian_structure",
    "hessian": "hessian_structure",
}


class _ProgramStructure(ctypes.Structure):
    _fields_ = (
        ("n", _long), ("hessian_entries", _long), ("cost", SumsStructure), ("rows", SumsStructure),
        ("gradient_columns", _address),
    )  # fmt: skip


class _RunStructure(ctypes.Structure):
    _fields_ = (
        ("program", _address), ("x_scales", _address), ("gradient_scales", _address), ("row_scales", _address),
        ("entry_scales", _address), ("hessian_scales", _address), ("objective_scale", _number), ("x", _address),
        ("multipliers", _address), ("undefined_at", _address), ("undefined", _int), ("seconds", _number),
        ("jacobian_rows", _address), ("jacobian_columns", _address), ("hessian_rows", _address),
        ("hessian_columns", _address),
    )  # fmt: skip


class CompiledRun:
    """The functions of a program, or of the same in other units, for one run of Ipopt.

    Parameters
    ----------
    library : ctypes.CDLL
    cost, rows : CompiledSums
    n : int
        Count of variables.
    gradient_columns : int array
        Variables of the entries of the objective's Jacobian.
    jacobian_structure, hessian_structure : pairs of int arrays
    scales : Scales, optional
        The units of the point that Ipopt has; see `ScaledProgram`.

    Attributes
    ----------
    functions : dict of str to int
        Addresses of the functions by their names in `NonlinearProgram`.
    data : int
        Address of what they get as their last argument.
    """

    def __init__(
        self,
        library: ctypes.CDLL,
        cost: CompiledSums,
        rows: CompiledSums,
        n: int,
        gradient_columns: np.ndarray,
        jacobian_structure: tuple[IndexArray, IndexArray],
        hessian_structure: tuple[IndexArray, IndexArray],
        scales: Scales | None = None,
    ) -> None:
        m = rows.structure.rows
        self._arrays: list[np.ndarray] = []
        self._owners = cost, rows
        structures = [self._kept(indices, np.int32) for indices in (*jacobian_structure, *hessian_structure)]
        self._undefined_at = np.empty(n)
        program = _ProgramStructure(
            n, hessian_structure[0].size, cost.structure, rows.structure, self._kept(gradient_columns, np.int32)
        )
        units: list[int | None] = [None] * 5
        objective_scale = 1.0
        if scales is not None:
            objective_scale = scales.objective
            factors = (
                scales.x,
                scales.x / scales.objective,
                scales.g,
                scales.x[jacobian_structure[1]] / scales.g[jacobian_structure[0]],
                scales.x[hessian_structure[0]] * scales.x[hessian_structure[1]],
            )
            units = [self._kept(factor) for factor in factors]
        self._run = _RunStructure(
            ctypes.addressof(program), *units, objective_scale, self._kept(np.empty(n)), self._kept(np.empty(m)),
            self._undefined_at.ctypes.data, 0, 0.0, *structures,
        )  # fmt: skip
        self._program, self._library = program, library
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
        self._run.seconds, self._run.undefined = 0.0, 0

    @property
    def seconds(self) -> float:
        """Time within the functions so far."""
        return float(self._run.seconds)

    @property
    def undefined_at(self) -> FloatArray | None:
        """The last point, in Ipopt's units, at which a value or a derivative did not exist."""
        return self._undefined_at.copy() if self._run.undefined else None


def compiled_functions_of(nlp: NonlinearProgram) -> tuple[CompiledRun | None, dict[str, int]]:
    """Functions of a program that Ipopt may call without Python, by name, and the run that they belong to.

    A program offers its functions by a method ``compiled_run(scales)``. Each of them counts as long as its own class
    evaluates it: not where a subclass or a wrapper does so in another way, or where it was replaced on the object.
    What a wrapper forwards as it is, as `ShiftedRows` does with all but the rows, counts.
    """
    run, owner, found = None, None, {}
    for name, structure in EVALUATIONS.items():
        method = getattr(nlp, name, None)
        program = getattr(method, "__self__", None)
        if program is None or (owner is not None and program is not owner) or not _evaluates(program, name, method):
            continue
        if structure is not None and getattr(nlp, structure) is not getattr(program, structure):
            continue
        if owner is None:
            run, owner = program.compiled_run(), program
        if run is not None:
            found[name] = run.functions[name]
    return run, found


def compiled_run_of(nlp: NonlinearProgram, scales: Scales) -> CompiledRun | None:
    """All functions of a program in other units; None where Python has to evaluate any of them."""
    if not all(_evaluates(nlp, name, getattr(nlp, name, None)) for name in EVALUATIONS):
        return None
    run: CompiledRun | None = nlp.compiled_run(scales)  # type: ignore[attr-defined]
    return run


def _evaluates(program: Any, name: str, method: Any) -> bool:
    """Whether a method is the one of the program's class, which has compiled functions as well."""
    own = vars(type(program))
    return "compiled_run" in own and name in own and getattr(method, "__func__", None) is own[name]
