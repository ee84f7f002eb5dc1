"""The backends to Ipopt that are present on this machine, best first."""

from __future__ import annotations

import enum
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from pyomo.common import Executable
from pyomo.common.fileutils import find_executable

from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.native.shared_library import HOW_TO_COMPILE
from pyrobocop_pyomo.programs.asl_program import asl_available
from pyrobocop_pyomo.programs.vectorised_program import casadi_available

from .ipopt_library import LIBRARY_VARIABLE, find_ipopt_library

EXECUTABLE_VARIABLE = "PYROBOCOP_IPOPT_EXECUTABLE"


def find_ipopt_executable() -> str | None:
    """Path of an ``ipopt`` executable, or None; nothing is started.

    The order: the environment variable ``PYROBOCOP_IPOPT_EXECUTABLE``; where Pyomo looks (PATH, ``~/.pyomo/bin``, a
    path set before); the ``bin`` folder of this Python environment, where ``build_asl.py`` puts it; the folder of
    IDAES.

    Raises
    ------
    SolverNotFoundError
        When the variable names a file that cannot be executed.
    """
    chosen = os.environ.get(EXECUTABLE_VARIABLE)
    if chosen:
        if not os.access(chosen, os.X_OK) or Path(chosen).is_dir():
            raise SolverNotFoundError(
                f"{EXECUTABLE_VARIABLE} is '{chosen}', which is no executable file. Correct the variable or unset it."
            )
        return chosen
    known = Executable("ipopt").path()
    if known:
        return str(known)
    folders = [
        os.path.join(sys.prefix, "bin"),
        os.path.join(sys.prefix, "Library", "bin"),
        os.path.expanduser("~/.idaes/bin"),
    ]
    found: str | None = find_executable("ipopt", cwd=False, include_PATH=False, pathlist=folders)
    return found


def configure_ipopt_executable() -> str | None:
    """Let Pyomo's own solvers ``ipopt`` and ``ipopt_v2`` find the executable of this Python environment.

    Importing this package changes nothing of Pyomo, and the solvers of this package need no call: this function is
    for ``SolverFactory("ipopt")`` in a Python environment where ``build_asl.py`` or conda has put the executable,
    without its folder being on PATH. An executable that Pyomo finds by itself stays the one that it uses, unless the
    environment variable ``PYROBOCOP_IPOPT_EXECUTABLE`` asks for another.

    Returns
    -------
    str or None
        Path of the executable that Pyomo uses from now on; None when there is none.

    Raises
    ------
    SolverNotFoundError
        When the variable names a file that cannot be executed.
    """
    path = find_ipopt_executable()
    if path is not None and path != Executable("ipopt").path():
        Executable("ipopt").set_path(path)
    return path


def ipopt_executable_version(path: str) -> str | None:
    """First line of ``ipopt --version``, or None when it cannot be run or is no Ipopt."""
    try:
        run = subprocess.run([path, "--version"], capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    line = run.stdout.strip().partition("\n")[0]
    return line if run.returncode == 0 and line.lower().startswith("ipopt") else None


WAYS_TO_IPOPT = f"""\
Any one of these brings Ipopt, and derivatives for it:
  pip install 'pyrobocop_pyomo[ipopt]'      CasADi's Ipopt, used in this process: works at once
  conda install -c conda-forge ipopt        the ipopt executable
  python build_asl.py, in a clone           Debian, Ubuntu: the executable, and ASL for use in this process
or, for an Ipopt that is there already, one of these environment variables:
  {EXECUTABLE_VARIABLE}=/path/to/ipopt
  {LIBRARY_VARIABLE}=/path/to/libipopt.so
The linear solver of this package: {HOW_TO_COMPILE}.
'python -m pyrobocop_pyomo doctor' shows what is found and what is missing."""


NO_IPOPT = f"no Ipopt is found on this machine. {WAYS_TO_IPOPT}"


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
