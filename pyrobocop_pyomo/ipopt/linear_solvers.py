"""Which linear solver a run of Ipopt uses: its own, or the one of this package behind MA27's calling convention."""

from __future__ import annotations

import functools
import logging
from collections.abc import Mapping
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.linear_solver.factorisation import (
    FactorSize,
    SymmetricFactorisation,
    find_linear_solver,
    required_linear_solver,
)
from pyrobocop_pyomo.programs.nonlinear_program import NonlinearProgram

from .ipopt_outcome import IpoptStatus

logger = logging.getLogger(__name__)

# The word for the solver of this package, among Ipopt's own: options={"linear_solver": "ldl"}.
OWN_SOLVER = "ldl"
# Where a run ends like this, the linear solver may be at fault: another one has a try from the same start.
IN_DOUBT = (
    IpoptStatus.STEP_FAILED,
    IpoptStatus.RESTORATION_FAILED,
    IpoptStatus.INTERNAL_ERROR,
    IpoptStatus.OUT_OF_MEMORY,
)
# Rows of a dense front up to which it is at least as fast as MUMPS with its BLAS (benchmarks/linear_solvers.py).
LARGEST_FRONT = 150
# Systems with so few entries, and so few in a row, have no such front: to order them would take longer than a step.
FEW_ENTRIES, THIN = 20_000, 10
FALL_BACK = {"linear_solver": "mumps"}
# What records of a run say where that happened.
FELL_BACK = "mumps, after ldl failed"
# At the head of Ipopt's log, which calls it by the name of the convention.
SAID_OF_OWN_SOLVER = (
    f"Linear solver 'ma27' below stands for the one of this package ('{OWN_SOLVER}'): Ipopt loads it by MA27's "
    "convention.\n"
)


def linear_solver_options() -> dict[str, str]:
    """Options with which any Ipopt from version 3.14 on loads the linear solver of this package.

    For solvers other than the solver of this package::

        pyo.SolverFactory("pyrobocop.ipopt").solve(m, options=linear_solver_options())
        nlpsol("solver", "ipopt", nlp, {"ipopt": linear_solver_options()})  # CasADi

    In a file of options for the ``ipopt`` executable each is a line: ``linear_solver ma27``, ``hsllib /path``; on its
    command line ``hsllib`` is no option.

    Returns
    -------
    dict of str to str
        ``linear_solver`` and ``hsllib``.

    Raises
    ------
    SolverNotFoundError
        When there is no compiled linear solver.
    """
    return {"linear_solver": "ma27", "hsllib": required_linear_solver()}


def with_linear_solver(options: Mapping[str, Any], nlp: NonlinearProgram | None = None) -> tuple[dict[str, Any], bool]:
    """Options in Ipopt's own words, and whether they ask for the solver of this package.

    Parameters
    ----------
    options : mapping
        Where they name neither a ``linear_solver`` nor an ``hsllib``, the program decides.
    nlp : NonlinearProgram, optional
        Without it, Ipopt decides.

    Raises
    ------
    SolverNotFoundError
        When it is requested and not there.
    ModelError
        When it is requested together with another library.
    """
    is_requested = options.get("linear_solver") == OWN_SOLVER
    if is_requested and "hsllib" in options:
        raise ModelError(
            f"linear_solver='{OWN_SOLVER}' is the solver of this package, and hsllib='{options['hsllib']}' another "
            "one. Leave one of both out, or name what that library has: linear_solver='ma27' or 'ma57'."
        )
    is_open = not {"linear_solver", "hsllib"}.intersection(options)
    if is_requested or (is_open and nlp is not None and suits(nlp)):
        return {**options, **linear_solver_options()}, True
    return dict(options), False


def refused_options(options: Mapping[str, Any]) -> ModelError:
    """The message where Ipopt refused options before its first iteration: why is in its log only."""
    return ModelError(
        f"Ipopt refused its options as inconsistent: {dict(options)}. Its log says which, and why: tee=True. Of linear "
        f"solvers 'mumps' and '{OWN_SOLVER}' are there; those of HSL and Pardiso it loads, options={{'linear_solver': "
        "'ma57', 'hsllib': '/path/to/libhsl.so'}."
    )


def suits(nlp: NonlinearProgram) -> bool:
    """Whether the solver of this package is there, and the fronts of the program's linear systems are small enough.

    A large dense front is where MUMPS, with its BLAS, is faster; small and thin systems are not asked.
    """
    if find_linear_solver() is None:
        return False
    rows, entries = nlp.n + nlp.m, nlp.n + nlp.hessian_structure[0].size + nlp.jacobian_structure[0].size
    if entries <= FEW_ENTRIES or rows <= LARGEST_FRONT:
        return rows <= LARGEST_FRONT or entries <= THIN * rows
    found = predicted_factor(nlp)
    return found is not None and found.largest_front <= LARGEST_FRONT


def predicted_factor(nlp: NonlinearProgram) -> FactorSize | None:
    """Size of the factor of Ipopt's linear systems, from the structure of the derivatives; None without the solver
    or where the factor is too large.

    Kept for further programs with the same structure.
    """
    if nlp.n == 0 or find_linear_solver() is None:
        return None
    hessian, jacobian = nlp.hessian_structure, nlp.jacobian_structure
    entries = [np.concatenate([hessian[side], jacobian[side]], dtype=np.int32).tobytes() for side in (0, 1)]
    return _size_of_factor(nlp.n, nlp.m, hessian[0].size, *entries)


@functools.lru_cache
def _size_of_factor(n: int, m: int, hessian_entries: int, rows: bytes, columns: bytes) -> FactorSize | None:
    below, beside = np.frombuffer(rows, np.int32).copy(), np.frombuffer(columns, np.int32)
    below[hessian_entries:] += n
    diagonal = np.arange(n)
    entries = np.concatenate([below, diagonal]), np.concatenate([beside, diagonal])
    return SymmetricFactorisation(n + m, *entries).size_of_factor(np.ones(entries[0].size))
