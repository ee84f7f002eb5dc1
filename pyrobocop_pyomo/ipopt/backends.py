"""The backends to Ipopt that are present on this machine, best first."""

from __future__ import annotations

import enum
from collections.abc import Callable

from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.programs.asl_program import asl_available
from pyrobocop_pyomo.programs.vectorised_program import casadi_available

from .ipopt_executable import EXECUTABLE_VARIABLE, find_ipopt_executable
from .ipopt_library import LIBRARY_VARIABLE, find_ipopt_library

NO_IPOPT = f"""\
no Ipopt is found on this machine. Any one of these brings it:
  pip install 'pyrobocop_pyomo[ipopt]'      CasADi's Ipopt, used in this process: works at once
  conda install -c conda-forge ipopt        the ipopt executable
  python build_asl.py, in a clone           Debian, Ubuntu: the executable, and ASL for use in this process
or, for an Ipopt that is there already, one of these environment variables:
  {EXECUTABLE_VARIABLE}=/path/to/ipopt
  {LIBRARY_VARIABLE}=/path/to/libipopt.so
'python -m pyrobocop_pyomo doctor' shows what is found and what is missing."""


class Backend(enum.Enum):
    """Where Ipopt runs, and where its derivatives come from; the value is a description."""

    IN_PROCESS_VECTORISED = "Ipopt in this process, derivatives by CasADi on vectorised expressions"
    IN_PROCESS_CASADI = IN_PROCESS_VECTORISED  # another name of the same
    IN_PROCESS_ASL = "Ipopt in this process, derivatives by ASL through PyNumero"
    EXECUTABLE = "the ipopt executable, derivatives by ASL"

    @property
    def derivatives(self) -> str | None:
        """What `CompiledModel` calls the source of derivatives; None for the executable."""
        return {Backend.IN_PROCESS_VECTORISED: "vectorised", Backend.IN_PROCESS_ASL: "asl"}.get(self)


def available_backends() -> list[Backend]:
    """Backends that are present, best first; nothing is loaded or started."""
    in_process = _found(find_ipopt_library)
    present = {
        Backend.IN_PROCESS_VECTORISED: in_process and casadi_available(),
        Backend.IN_PROCESS_ASL: in_process and asl_available(),
        Backend.EXECUTABLE: _found(find_ipopt_executable),
    }
    return [backend for backend in Backend if present[backend]]


def best_backend() -> Backend:
    """The best backend that is present.

    Raises
    ------
    SolverNotFoundError
        When there is none; the message lists the remedies.
    """
    backends = available_backends()
    if not backends:
        raise SolverNotFoundError(NO_IPOPT)
    return backends[0]


def _found(find: Callable[[], str | None]) -> bool:
    """A variable that names a missing file means: not found. Whoever then asks for that backend gets the message."""
    try:
        return find() is not None
    except SolverNotFoundError:
        return False
