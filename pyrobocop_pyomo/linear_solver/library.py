"""The compiled linear solver, and where it is looked for."""

from __future__ import annotations

import functools
import os
from pathlib import Path

from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.native.shared_library import HOW_TO_COMPILE, SWITCH_VARIABLE, shared_library

LINEAR_SOLVER_VARIABLE = "PYROBOCOP_LINEAR_SOLVER"
LINEAR_SOLVER_NAME = "linear_solver"


def find_linear_solver() -> str | None:
    """Path of the compiled linear solver, or None where there is none.

    The environment variable ``PYROBOCOP_LINEAR_SOLVER`` may name a library that speaks MA27's convention, or be
    ``none``. Otherwise it is the one that was compiled when the package was installed; with ``PYROBOCOP_NATIVE=off``,
    or where there was no C compiler, there is none.

    Raises
    ------
    SolverNotFoundError
        When the variable names a file that does not exist.
    """
    chosen = os.environ.get(LINEAR_SOLVER_VARIABLE)
    if chosen:
        if chosen.lower() == "none":
            return None
        if not Path(chosen).is_file():
            raise SolverNotFoundError(
                f"{LINEAR_SOLVER_VARIABLE} is '{chosen}', but there is no such file. Correct the variable, unset it, "
                "or set it to 'none'."
            )
        return str(Path(chosen).resolve())
    return _compiled(os.environ.get(SWITCH_VARIABLE, ""))


def required_linear_solver() -> str:
    """As `find_linear_solver`, but refused where there is none."""
    path = find_linear_solver()
    if path is None:
        raise SolverNotFoundError(
            f"there is no compiled linear solver: {HOW_TO_COMPILE}; "
            "PYROBOCOP_NATIVE and PYROBOCOP_LINEAR_SOLVER must not say 'off' or 'none'. Ipopt's own is MUMPS."
        )
    return path


@functools.cache
def _compiled(_switch: str) -> str | None:
    """Asked once for each setting of the environment: hashing sources takes as long as a small solve."""
    found = shared_library(LINEAR_SOLVER_NAME)
    return None if found is None else str(found)
